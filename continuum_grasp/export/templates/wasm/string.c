#include "string.h"

void *memcpy(void *to, const void *from, size_t count)
{
  char *a = to;
  const char *b = from;
  while (count--) *a++ = *b++;
  return to;
}

void *memset(void *to, int value, size_t count)
{
  char *a = to;
  while (count--) *a++ = (char)value;
  return to;
}

int memcmp(const void *one, const void *other, size_t count)
{
  const unsigned char *a = one, *b = other;
  for (; count; --count, ++a, ++b)
    if (*a != *b) return *a < *b ? -1 : 1;
  return 0;
}
