/* A stable sort by rising numbers, digit by digit: no comparison that a processor could guess wrong. */
#include "planner.h"

#include <string.h>

enum { DIGITS = 8, VALUES = 256 };

/* Bits whose order as a whole number is that of the number itself; 0 and −0 are equal. */
static uint64_t ordered_bits(double number)
{
    uint64_t bits;
    number += 0.0;
    memcpy(&bits, &number, sizeof(bits));
    return bits >> 63 ? ~bits : bits | (uint64_t)1 << 63;
}

void sort_indices(const double *keys, ptrdiff_t count, int64_t *order, int64_t *spare, uint64_t *bits)
{
    ptrdiff_t starts[DIGITS][VALUES];
    int64_t *from = order, *to = spare;
    memset(starts, 0, sizeof(starts));
    for (ptrdiff_t i = 0; i < count; i++) {
        bits[i] = ordered_bits(keys[i]);
        for (int digit = 0; digit < DIGITS; digit++)
            starts[digit][bits[i] >> 8 * digit & 255]++;
    }
    for (int digit = 0; digit < DIGITS && count > 0; digit++) {
        ptrdiff_t *start = starts[digit], sum = 0;
        if (start[bits[0] >> 8 * digit & 255] == count)
            continue; /* all have the same */
        for (int value = 0; value < VALUES; value++) {
            const ptrdiff_t number = start[value];
            start[value] = sum;
            sum += number;
        }
        for (ptrdiff_t i = 0; i < count; i++)
            to[start[bits[from[i]] >> 8 * digit & 255]++] = from[i];
        int64_t *swap = from;
        from = to;
        to = swap;
    }
    if (from != order && count > 0)
        memcpy(order, from, (size_t)count * sizeof(*order));
}
