/* A cloud's size and shape in numbers that no rotation changes: see pec.known.shape_distribution, its reference. */
#include "preprocessing.h"

#include <string.h>

#define QUANTILES 17
#define DIGIT 8 /* bits of a number that one pass of the sorting looks at */

/* Floats that are not negative sort as the integers of the same bits. Four passes, least digit first. */
static void sort(uint32_t *values, uint32_t *spare, ptrdiff_t n)
{
    for (int shift = 0; shift < 4 * DIGIT; shift += DIGIT) {
        uint32_t begins[1 << DIGIT] = {0}, begin = 0;
        for (ptrdiff_t i = 0; i < n; i++)
            begins[values[i] >> shift & ((1 << DIGIT) - 1)]++;
        for (int digit = 0; digit < 1 << DIGIT; digit++) {
            const uint32_t count = begins[digit];
            begins[digit] = begin;
            begin += count;
        }
        for (ptrdiff_t i = 0; i < n; i++)
            spare[begins[values[i] >> shift & ((1 << DIGIT) - 1)]++] = values[i];
        uint32_t *const other = values;
        values = spare;
        spare = other;
    }
}

static void roots_of_quantiles(const uint32_t *sorted, ptrdiff_t n, double *out)
{
    for (int k = 0; k < QUANTILES; k++) {
        float squared;
        memcpy(&squared, sorted + lrint(k * (double)(n - 1) / (QUANTILES - 1)), sizeof squared);
        out[k] = sqrt((double)squared);
    }
}

/* Squared distances of point `from` to those before it. */
WIDE static void distances(const float *x, const float *y, const float *z, ptrdiff_t from, float *out)
{
    for (ptrdiff_t i = 0; i < from; i++)
        out[i] = squared_length(x[i] - x[from], y[i] - y[from], z[i] - z[from]);
}

int describe_points(const float *points, ptrdiff_t n, double *out)
{
    const ptrdiff_t pairs = n * (n - 1) / 2, most = pairs > n ? pairs : n;
    float *const x = malloc((size_t)(3 * n + 2 * most) * sizeof(float));
    if (!x)
        return 0;
    float *const y = x + n, *const z = y + n, *const values = z + n;
    uint32_t *const spare = (uint32_t *)(values + most), *const bits = (uint32_t *)values;
    double mean[3] = {0, 0, 0}, spread[3][3] = {{0}}, axes[3][3];
    for (ptrdiff_t i = 0; i < 3 * n; i++)
        mean[i % 3] += points[i] / (double)n;
    for (ptrdiff_t i = 0; i < n; i++) {
        double point[3];
        for (int axis = 0; axis < 3; axis++)
            (axis == 0 ? x : axis == 1 ? y : z)[i] = (float)(point[axis] = points[3 * i + axis] - mean[axis]);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                spread[a][b] += point[a] * point[b] / (double)n;
    }
    for (ptrdiff_t i = 0, done = 0; i < n; done += i++)
        distances(x, y, z, i, values + done);
    if (n > 1)
        sort(bits, spare, pairs);
    else
        bits[0] = 0;
    roots_of_quantiles(bits, n > 1 ? pairs : 1, out);
    for (ptrdiff_t i = 0; i < n; i++)
        values[i] = squared_length(x[i], y[i], z[i]);
    sort(bits, spare, n);
    roots_of_quantiles(bits, n, out + QUANTILES);
    principal_axes(spread, axes);
    for (int axis = 0; axis < 3; axis++) { /* the smallest first */
        int rank = 0;
        for (int other = 0; other < 3; other++)
            rank += spread[other][other] < spread[axis][axis] || (spread[other][other] == spread[axis][axis] && other < axis);
        out[2 * QUANTILES + rank] = sqrt(spread[axis][axis] > 0.0 ? spread[axis][axis] : 0.0);
    }
    free(x);
    return 1;
}
