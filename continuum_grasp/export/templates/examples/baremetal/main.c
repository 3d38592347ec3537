/* On the board: runs all test vectors, then says instructions and stack of each function over its vectors, one line
   "NAME least most stack". */
#include "board.h"
#include "check.h"

#define REPEAT 40

static uint32_t instructions(int function, int row)
{
  uint32_t start, empty, full;
  board_clock_start();
  start = board_ticks();
  check_run(function, row, 0);
  empty = board_ticks() - start;
  board_clock_start();
  start = board_ticks();
  check_run(function, row, REPEAT);
  full = board_ticks() - start;
  return (full - empty) * BOARD_INSTRUCTIONS_PER_TICK / REPEAT;
}

static uint32_t stack(int function, int repeat)
{
  uint32_t deepest = 0;
  int row;
  for (row = 0; row < check_rows(function); ++row) {
    uint32_t used;
    board_stack_paint();
    check_run(function, row, repeat);
    used = board_stack_used(__builtin_frame_address(0));
    if (used > deepest) deepest = used;
  }
  return deepest;
}

int main(void)
{
  int function, row, failures = 0;
  for (function = 0; function < CHECK_FUNCTIONS; ++function) failures += check_failures(function, 0);
  board_say_number((uint32_t)failures);
  board_say(" failures\n");
  for (function = 0; function < CHECK_FUNCTIONS; ++function) {
    uint32_t least = 0xFFFFFFFFu, most = 0;
    for (row = 0; row < check_rows(function); ++row) {
      const uint32_t count = instructions(function, row);
      if (count < least) least = count;
      if (count > most) most = count;
    }
    board_say(check_name(function));
    board_say(" ");
    board_say_number(least);
    board_say(" ");
    board_say_number(most);
    board_say(" ");
    board_say_number(stack(function, 1));
    board_say("\n");
  }
  return failures != 0;
}
