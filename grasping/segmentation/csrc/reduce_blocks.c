/* See working_image.reduce_blocks: the blocks of a row side by side, sorted by a network of exchanges. */
#include "segmentation.h"

#include <math.h>
#include <stdlib.h>

#define ALIKE 0.01f

/* Put the lesser of each two numbers first. */
static void exchange(float *restrict low, float *restrict high, ptrdiff_t count)
{
    for (ptrdiff_t i = 0; i < count; i++) {
        const float a = low[i], b = high[i];
        const int rising = a < b ? -1 : 0;
        low[i] = choose(rising, a, b);
        high[i] = choose(rising, b, a);
    }
}

/* How many of n measurements, rising, there are, and the median of those: of each block. sorted: n rows. */
static void find_medians(const float *sorted, ptrdiff_t n, ptrdiff_t columns, int *restrict measured, float *restrict median)
{
    for (ptrdiff_t i = 0; i < columns; i++)
        measured[i] = 0;
    for (ptrdiff_t k = 0; k < n; k++) {
        const float *restrict row = sorted + k * columns;
        for (ptrdiff_t i = 0; i < columns; i++)
            measured[i] += row[i] > 0.0f;
    }
    for (ptrdiff_t k = 0; k < n; k++) { /* the last are the measured ones */
        const float *restrict row = sorted + k * columns;
        const int from_last = (int)(n - k);
        for (ptrdiff_t i = 0; i < columns; i++)
            median[i] = choose((measured[i] + 1) >> 1 == from_last ? -1 : 0, row[i], median[i]);
    }
}

/* The mean of what lies about the median; 0 where half of a block were not measured. */
static void average(const float *sorted, ptrdiff_t n, ptrdiff_t columns, const int *restrict measured,
                    const float *restrict median, float *restrict count, float *restrict mean)
{
    for (ptrdiff_t i = 0; i < columns; i++)
        mean[i] = count[i] = 0.0f;
    for (ptrdiff_t k = 0; k < n; k++) {
        const float *restrict row = sorted + k * columns;
        for (ptrdiff_t i = 0; i < columns; i++) {
            const int near = (row[i] > 0.0f) & (fabsf(row[i] - median[i]) < ALIKE);
            mean[i] += near ? row[i] : 0.0f;
            count[i] += near ? 1.0f : 0.0f;
        }
    }
    const int half = (int)n;
    for (ptrdiff_t i = 0; i < columns; i++) {
        const float of_all = mean[i] / (count[i] >= 1.0f ? count[i] : 1.0f);
        mean[i] = 2 * measured[i] >= half ? of_all : 0.0f;
    }
}

int reduce_blocks(const float *q, ptrdiff_t h, ptrdiff_t w, ptrdiff_t block, float *out)
{
    const ptrdiff_t n = block * block, rows = h / block, columns = w / block;
    float *lanes = calloc((size_t)((n + 3) * columns), sizeof(*lanes)); /* n rows, a column for each block */
    if (!lanes)
        return OUT_OF_MEMORY;
    float *median = lanes + n * columns, *count = median + columns;
    int *measured = (int *)(count + columns);
    for (ptrdiff_t row = 0; row < rows; row++) {
        for (ptrdiff_t k = 0; k < n; k++)
            for (ptrdiff_t i = 0; i < columns; i++)
                lanes[k * columns + i] = q[(row * block + k / block) * w + i * block + k % block];
        for (ptrdiff_t last = n - 1; last > 0; last--)
            for (ptrdiff_t k = 0; k < last; k++)
                exchange(lanes + k * columns, lanes + (k + 1) * columns, columns);
        find_medians(lanes, n, columns, measured, median);
        average(lanes, n, columns, measured, median, count, out + row * columns);
    }
    free(lanes);
    return 0;
}
