/* What the test vectors need of the C library. */
#include <stddef.h>

void *memcpy(void *to, const void *from, size_t count);
int memcmp(const void *one, const void *other, size_t count);
