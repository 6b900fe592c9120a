/* What the flight code needs of <string.h>; flight.c has the functions. */
#ifndef EXPLORER_STRING_H
#define EXPLORER_STRING_H
#include <stddef.h>
void *memcpy(void *to, const void *from, size_t size);
void *memset(void *to, int value, size_t size);
int memcmp(const void *one, const void *other, size_t size);
#endif
