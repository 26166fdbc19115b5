/* See table_relief.mean_of_nine: three rows are added up, then three columns of the sums. */
#include "segmentation.h"

#include <stdlib.h>

/* Add up a pixel and those above and below it, where they are measured; rows out of the image do not count. */
static void add_rows(const float *values, const float *q, ptrdiff_t h, ptrdiff_t w, ptrdiff_t row, float most,
                     float *restrict total, float *restrict number)
{
    for (ptrdiff_t column = 0; column < w; column++)
        total[column] = number[column] = 0.0f;
    for (ptrdiff_t from = row - 1; from <= row + 1; from++) {
        if (from < 0 || from >= h)
            continue;
        const float *restrict value = values + from * w;
        const float *restrict own = q + from * w;
        for (ptrdiff_t column = 0; column < w; column++) {
            const float counted = minimum(maximum(value[column], -most), most);
            total[column] += own[column] > 0.0f ? counted : 0.0f;
            number[column] += own[column] > 0.0f ? 1.0f : 0.0f;
        }
    }
}

int mean_of_nine(const float *values, const float *q, ptrdiff_t h, ptrdiff_t w, float most, float *restrict mean)
{
    float *const sums = calloc((size_t)(2 * (w + 2)), sizeof(*sums)); /* a column of zeros to both sides */
    if (!sums)
        return OUT_OF_MEMORY;
    const float *restrict total = sums, *restrict number = sums + w + 2;
    for (ptrdiff_t row = 0; row < h; row++) {
        add_rows(values, q, h, w, row, most, sums + 1, sums + w + 3);
        for (ptrdiff_t column = 0; column < w; column++) {
            const float count = number[column] + number[column + 1] + number[column + 2];
            const float sum = total[column] + total[column + 1] + total[column + 2];
            mean[row * w + column] = sum / (count >= 1.0f ? count : 1.0f);
        }
    }
    free(sums);
    return 0;
}
