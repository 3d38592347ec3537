/* Start of a Cortex-M4F or -M7 without a library: vector table, floating-point unit, memory; and what a program says to a
   debugger or emulator by semihosting. Made for the boards MPS2 AN386 and AN500 that QEMU emulates; for another board
   change board.ld, and drop the semihosting where no debugger is attached. */
#include "board.h"

#include <stddef.h>

extern uint32_t data_source[], data_start[], data_end[], bss_start[], bss_end[], stack_top[], stack_limit[];
int main(void);
void reset(void);

static void stop(void)
{
  board_exit(1);
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))stack_top, reset, stop, stop, stop, stop, stop, 0, 0, 0, 0, stop, stop, 0, stop, stop};

void reset(void)
{
  uint32_t *to, *from;
  *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: full access to the floating-point unit, before any use */
  __asm volatile("dsb\n\tisb" ::: "memory");
  for (to = data_start, from = data_source; to < data_end;) *to++ = *from++;
  for (to = bss_start; to < bss_end;) *to++ = 0;
  board_exit(main());
}

static int semihost(int operation, const void *argument)
{
  register int r0 __asm("r0") = operation;
  register const void *r1 __asm("r1") = argument;
  __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

void board_exit(int status)
{
  const uint32_t reason[2] = {0x20026u /* the application ended */, (uint32_t)status};
  semihost(0x20 /* SYS_EXIT_EXTENDED */, reason);
  for (;;) {}
}

void board_say(const char *text)
{
  semihost(0x04 /* SYS_WRITE0 */, text);
}

void board_say_number(uint32_t number)
{
  char digits[11], *at = digits + sizeof digits - 1;
  *at = 0;
  do { *--at = (char)('0' + number % 10u); } while ((number /= 10u) != 0);
  board_say(at);
}

/* SysTick counts down in 24 bits from the board's 25 MHz. Under -icount shift=0 an instruction takes 1 ns, so that a tick
   is 40 instructions. */
void board_clock_start(void)
{
  *(volatile uint32_t *)0xE000E014u = 0xFFFFFFu;
  *(volatile uint32_t *)0xE000E018u = 0;
  *(volatile uint32_t *)0xE000E010u = 5;
  while (*(volatile uint32_t *)0xE000E018u == 0) {} /* it begins with a zero */
}

uint32_t board_ticks(void)
{
  return 0xFFFFFFu - (*(volatile uint32_t *)0xE000E018u & 0xFFFFFFu);
}

/* The stack below the caller is painted, and afterwards looked through for the deepest word that was written. */
#define PAINT 0xC5C5C5C5u

__attribute__((noinline)) void board_stack_paint(void)
{
  volatile uint32_t *word = (volatile uint32_t *)__builtin_frame_address(0) - 16;
  while (word > stack_limit) *--word = PAINT;
}

__attribute__((noinline)) uint32_t board_stack_used(const void *top)
{
  const volatile uint32_t *word = stack_limit;
  while (*word == PAINT) ++word;
  return (uint32_t)((const char *)top - (const char *)(uintptr_t)word);
}
