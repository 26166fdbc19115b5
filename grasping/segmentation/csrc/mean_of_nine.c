/* See table_relief.mean_of_nine: three rows are added up, then three columns of the sums. */
#include "segmentation.h"

#include <stdlib.h>

/* What counts of a row: its values where they are measured, and 1 there; nothing of a row out of the image. */
static void count_row(const float *values, const float *q, ptrdiff_t h, ptrdiff_t w, ptrdiff_t row, float most,
                      float *restrict counted, float *restrict number)
{
    if (row >= h) {
        memset(counted, 0, (size_t)w * sizeof(*counted));
        memset(number, 0, (size_t)w * sizeof(*number));
        return;
    }
    const float *restrict value = values + row * w, *restrict own = q + row * w;
    for (ptrdiff_t column = 0; column < w; column++) {
        const float limited = minimum(maximum(value[column], -most), most);
        counted[column] = own[column] > 0.0f ? limited : 0.0f;
        number[column] = own[column] > 0.0f ? 1.0f : 0.0f;
    }
}

int mean_of_nine(const float *values, const float *q, ptrdiff_t h, ptrdiff_t w, float most, float *restrict mean)
{
    float *const memory = calloc((size_t)(8 * (w + 2)), sizeof(*memory)); /* a column of zeros to both sides of sums */
    if (!memory)
        return OUT_OF_MEMORY;
    float *restrict total = memory + 1, *restrict number = memory + w + 3, *rows[3];
    for (int k = 0; k < 3; k++)
        rows[k] = memory + 2 * (k + 1) * (w + 2);
    count_row(values, q, h, w, 0, most, rows[1], rows[1] + w);
    for (ptrdiff_t row = 0; row < h; row++) {
        count_row(values, q, h, w, row + 1, most, rows[2], rows[2] + w);
        const float *restrict above = rows[0], *restrict own = rows[1], *restrict below = rows[2];
        for (ptrdiff_t column = 0; column < w; column++) {
            total[column] = above[column] + own[column] + below[column];
            number[column] = above[column + w] + own[column + w] + below[column + w];
        }
        float *restrict out = mean + row * w;
        for (ptrdiff_t column = 0; column < w; column++) {
            const float count = number[column - 1] + number[column] + number[column + 1];
            const float sum = total[column - 1] + total[column] + total[column + 1];
            out[column] = sum / (count >= 1.0f ? count : 1.0f);
        }
        float *const oldest = rows[0];
        rows[0] = rows[1];
        rows[1] = rows[2];
        rows[2] = oldest;
    }
    free(memory);
    return 0;
}
