/* See table_relief.py: what is above the table, and by more than its noise. */
#include "segmentation.h"

#include <stdlib.h>

#define WEAK 2.0f
#define MOST 8.0f
#define LEAST_MASS 80.0

void find_heights(const float *q, ptrdiff_t h, ptrdiff_t w, const float *across, const float *down, float camera,
                  float *plane, float *height)
{
    for (ptrdiff_t row = 0; row < h; row++) {
        const float *restrict own = q + row * w;
        float *restrict level = plane + row * w, *restrict high = height + row * w;
        for (ptrdiff_t column = 0; column < w; column++) {
            level[column] = across[column] + down[row];
            const float share = level[column] / own[column];
            high[column] = camera * (1.0f - (own[column] > 0.0f ? share : 0.0f));
        }
    }
}

void rise_over_table(const float *q, const float *plane, const float *bend, ptrdiff_t pixels, float *restrict table,
                     float *restrict above)
{
    for (ptrdiff_t i = 0; i < pixels; i++) {
        table[i] = plane[i] + bend[i];
        const float over = q[i] - table[i];
        above[i] = q[i] > 0.0f ? over : 0.0f;
    }
}

int stand_out(const Standing *from, ptrdiff_t h, ptrdiff_t w, unsigned char *out)
{
    const ptrdiff_t pixels = h * w;
    int32_t *labels = malloc((size_t)pixels * sizeof(*labels));
    if (!labels)
        return OUT_OF_MEMORY;
    const float *q = from->inverse_depth, *mean = from->mean, *above = from->above, *height = from->height;
    const float least_mean = from->least_mean, least_own = from->least_own, least_height = from->least_height;
    for (ptrdiff_t i = 0; i < pixels; i++) {
        const int32_t is = -(q[i] > 0.0f) & -(mean[i] > least_mean) & -(above[i] > least_own) & -(height[i] > least_height);
        labels[i] = is;
    }
    for (ptrdiff_t i = 0; i < pixels; i++)
        out[i] = (unsigned char)(labels[i] & 1);
    const ptrdiff_t count = label_pieces(out, h, w, labels);
    double *mass = count < 0 ? NULL : calloc((size_t)count + 1, sizeof(*mass));
    if (mass) {
        for (ptrdiff_t i = 0; i < pixels; i++)
            if (labels[i]) {
                const float over = from->mean[i] / from->level - WEAK;
                mass[labels[i]] += minimum(maximum(over, 0.0f), MOST);
            }
        for (ptrdiff_t i = 0; i < pixels; i++)
            out[i] = labels[i] && mass[labels[i]] >= LEAST_MASS;
    }
    const int code = mass ? 0 : OUT_OF_MEMORY;
    free(labels);
    free(mass);
    return code;
}
