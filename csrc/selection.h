/* The k-th smallest of some numbers, by Hoare's FIND; what is NaN ends anywhere, but nothing hangs. */
#ifndef GRASPING_SELECTION_H
#define GRASPING_SELECTION_H

#include <stddef.h>

#define SELECTION(name, real)                                                                                          \
    /* The one that would be at k, from `first` to `last`, were these in order; the others are left on its two sides. */ \
    static inline real name(real *values, ptrdiff_t first, ptrdiff_t last, ptrdiff_t k)                                \
    {                                                                                                                  \
        while (first < last) {                                                                                         \
            const real pivot = values[k];                                                                              \
            ptrdiff_t low = first, high = last;                                                                        \
            do {                                                                                                       \
                while (values[low] < pivot)                                                                            \
                    low++;                                                                                             \
                while (pivot < values[high])                                                                           \
                    high--;                                                                                            \
                if (low <= high) {                                                                                     \
                    const real swap = values[low];                                                                     \
                    values[low++] = values[high];                                                                      \
                    values[high--] = swap;                                                                             \
                }                                                                                                      \
            } while (low <= high);                                                                                     \
            if (high < k)                                                                                              \
                first = low;                                                                                           \
            if (k < low)                                                                                               \
                last = high;                                                                                           \
        }                                                                                                              \
        return values[k];                                                                                              \
    }

#endif
