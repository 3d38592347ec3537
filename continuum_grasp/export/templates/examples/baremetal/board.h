/* What start.c offers a program on the board. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

#define BOARD_INSTRUCTIONS_PER_TICK 40u

void board_exit(int status);
void board_say(const char *text);
void board_say_number(uint32_t number);
void board_clock_start(void);
uint32_t board_ticks(void);
void board_stack_paint(void);
uint32_t board_stack_used(const void *top);

#endif
