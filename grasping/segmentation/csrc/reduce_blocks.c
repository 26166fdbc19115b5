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
        low[i] = a < b ? a : b;
        high[i] = a < b ? b : a;
    }
}

/* The mean of what lies about the median of n measurements, rising; 0 where half were not measured. */
static float mean_about_median(const float *sorted, ptrdiff_t stride, ptrdiff_t n)
{
    ptrdiff_t measured = 0;
    for (ptrdiff_t k = 0; k < n; k++)
        measured += sorted[k * stride] > 0.0f;
    if (2 * measured < n)
        return 0.0f;
    const float median = sorted[(n - 1 - (measured > 0 ? (measured - 1) / 2 : 0)) * stride];
    float total = 0.0f, count = 0.0f;
    for (ptrdiff_t k = 0; k < n; k++) {
        const float value = sorted[k * stride];
        const int near = (value > 0.0f) & (fabsf(value - median) < ALIKE);
        total += near ? value : 0.0f;
        count += near ? 1.0f : 0.0f;
    }
    return total / (count >= 1.0f ? count : 1.0f);
}

int reduce_blocks(const float *q, ptrdiff_t h, ptrdiff_t w, ptrdiff_t block, float *out)
{
    const ptrdiff_t n = block * block, rows = h / block, columns = w / block;
    float *lanes = malloc((size_t)(n * columns + 1) * sizeof(*lanes)); /* n rows, a column for each block */
    if (!lanes)
        return OUT_OF_MEMORY;
    for (ptrdiff_t row = 0; row < rows; row++) {
        for (ptrdiff_t k = 0; k < n; k++)
            for (ptrdiff_t i = 0; i < columns; i++)
                lanes[k * columns + i] = q[(row * block + k / block) * w + i * block + k % block];
        for (ptrdiff_t last = n - 1; last > 0; last--)
            for (ptrdiff_t k = 0; k < last; k++)
                exchange(lanes + k * columns, lanes + (k + 1) * columns, columns);
        for (ptrdiff_t i = 0; i < columns; i++)
            out[row * columns + i] = mean_about_median(lanes + i, columns, n);
    }
    free(lanes);
    return 0;
}
