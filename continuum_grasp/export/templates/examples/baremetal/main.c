/* On the board: runs all test vectors, then says instructions and stack of each function over its vectors, one line
   "NAME least mean most stack"; of a function that keeps something also "NAME_start ..." and "NAME_hard ...", see check.h. */
#include "board.h"
#include "check.h"

#define REPEAT 40

static check_memory memory;

static uint32_t instructions(int function, int row)
{
  const int repeat = check_stateful(function) ? 1 : REPEAT;
  uint32_t start, empty, full;
  board_clock_start();
  start = board_ticks();
  check_run(function, row, 0, &memory);
  empty = board_ticks() - start;
  board_clock_start();
  start = board_ticks();
  check_run(function, row, repeat, &memory);
  full = board_ticks() - start;
  return (full - empty) * BOARD_INSTRUCTIONS_PER_TICK / (uint32_t)repeat;
}

static uint32_t stack(int function, int row)
{
  board_stack_paint();
  check_run(function, row, 1, &memory);
  return board_stack_used(__builtin_frame_address(0));
}

static void say(const char *text, uint32_t number)
{
  board_say(text);
  board_say_number(number);
}

static void measure(int function, int kind)
{
  static const char *const names[CHECK_KINDS] = {"", "_start", "_hard"};
  uint32_t least = 0xFFFFFFFFu, most = 0, deepest = 0, rows = 0;
  uint64_t sum = 0;
  int row;
  for (row = 0; row < check_rows(function); ++row) { /* all of them: some follow on each other */
    const uint32_t count = instructions(function, row);
    if (check_kind(function, row) != kind) continue;
    if (count < least) least = count;
    if (count > most) most = count;
    sum += count;
    ++rows;
  }
  for (row = 0; row < check_rows(function); ++row) {
    const uint32_t used = stack(function, row);
    if (check_kind(function, row) == kind && used > deepest) deepest = used;
  }
  if (most == 0) return;
  board_say(check_name(function));
  board_say(names[kind]);
  say(" ", least);
  say(" ", (uint32_t)(sum / rows));
  say(" ", most);
  say(" ", deepest);
  board_say("\n");
}

int main(void)
{
  int function, kind, failures = 0;
  for (function = 0; function < CHECK_FUNCTIONS; ++function) failures += check_failures(function, 0, &memory);
  board_say_number((uint32_t)failures);
  board_say(" failures\n");
  for (function = 0; function < CHECK_FUNCTIONS; ++function) {
    for (kind = 0; kind < (check_stateful(function) ? CHECK_KINDS : 1); ++kind) measure(function, kind);
  }
  return failures != 0;
}
