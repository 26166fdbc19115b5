/* How the surface of a cloud is formed: see pec.known.surface_forms, its reference. */
#include "preprocessing.h"

#include <string.h>

#define NEIGHBOURS 10
#define LEAST 1e-3
#define FLAT 1e-12

static const double DISTANCES[4] = {0.4, 0.8, 1.2, 1.7}, INCLINED[3] = {0.25, 0.7, 0.95}, OFF[3] = {0.1, 0.3, 0.6};

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double *quantiles(double *values, ptrdiff_t n, int count, double *out)
{
    qsort(values, (size_t)n, sizeof *values, ascending);
    for (int k = 0; k < count; k++)
        out[k] = values[lrint(k * (double)(n - 1) / (count - 1))];
    return out + count;
}

/* Eigenvalues, the smallest first, and eigenvectors, a row each, of the covariance of `count` points about their mean. */
static void plane(const double (*points)[3], const int *of, int count, double values[3], double vectors[3][3])
{
    double mean[3] = {0, 0, 0}, spread[3][3] = {{0}}, axes[3][3];
    for (int i = 0; i < count; i++)
        for (int a = 0; a < 3; a++)
            mean[a] += points[of ? of[i] : i][a] / count;
    for (int i = 0; i < count; i++) {
        const double *const point = points[of ? of[i] : i];
        for (int a = 0; a < 3; a++)
            for (int b = 0; b <= a; b++)
                spread[a][b] += (point[a] - mean[a]) * (point[b] - mean[b]) / count;
    }
    for (int a = 0; a < 3; a++)
        for (int b = a + 1; b < 3; b++)
            spread[a][b] = spread[b][a];
    principal_axes(spread, axes); /* columns, of falling eigenvalues */
    double found[3] = {spread[0][0], spread[1][1], spread[2][2]};
    qsort(found, 3, sizeof *found, ascending);
    for (int a = 0; a < 3; a++) {
        values[a] = found[a] > 0.0 ? found[a] : 0.0;
        for (int b = 0; b < 3; b++)
            vectors[a][b] = axes[b][2 - a];
    }
}

/* Squared distances of all n points from point `from`. */
WIDE static void distances(const double *x, const double *y, const double *z, ptrdiff_t n, ptrdiff_t from, double *out)
{
    const double at_x = x[from], at_y = y[from], at_z = z[from];
    for (ptrdiff_t i = 0; i < n; i++)
        out[i] = (x[i] - at_x) * (x[i] - at_x) + (y[i] - at_y) * (y[i] - at_y) + (z[i] - at_z) * (z[i] - at_z);
}

/* The `count` of n points that are nearest by their squared distances, the nearest first. */
static void nearest(const double *squared, ptrdiff_t n, int count, int *out)
{
    double away[NEIGHBOURS];
    int kept = 0;
    for (ptrdiff_t i = 0; i < n; i++) {
        if (kept == count && squared[i] >= away[count - 1])
            continue;
        int place = kept < count ? kept++ : count - 1;
        for (; place && away[place - 1] > squared[i]; place--) {
            away[place] = away[place - 1];
            out[place] = out[place - 1];
        }
        away[place] = squared[i];
        out[place] = (int)i;
    }
}

/* Of point `from` and each before it: four times which of five distances, plus which of four inclinations, and which of
 * four distances off the plane of the one and of the other. squared: the squared distances. */
WIDE static void bins(const double *x, const double *y, const double *z, const double *u, const double *v,
                      const double *w, ptrdiff_t from, const double *squared, double mean_distance, int32_t *inclined,
                      int32_t *off, int32_t *off_other)
{
    const double d0 = DISTANCES[0] * mean_distance, d1 = DISTANCES[1] * mean_distance,
                 d2 = DISTANCES[2] * mean_distance, d3 = DISTANCES[3] * mean_distance;
    for (ptrdiff_t i = 0; i < from; i++) {
        const double dx = x[i] - x[from], dy = y[i] - y[from], dz = z[i] - z[from];
        const double distance = sqrt(squared[i]), length = distance > 1e-9 ? distance : 1e-9;
        const int32_t far = 4 * ((distance >= d0) + (distance >= d1) + (distance >= d2) + (distance >= d3));
        const double cosine = fabs(u[i] * u[from] + v[i] * v[from] + w[i] * w[from]);
        const double sine = fabs(u[from] * dx + v[from] * dy + w[from] * dz) / length;
        const double sine_other = fabs(u[i] * dx + v[i] * dy + w[i] * dz) / length;
        inclined[i] = far + (cosine >= INCLINED[0]) + (cosine >= INCLINED[1]) + (cosine >= INCLINED[2]);
        off[i] = far + (sine >= OFF[0]) + (sine >= OFF[1]) + (sine >= OFF[2]);
        off_other[i] = far + (sine_other >= OFF[0]) + (sine_other >= OFF[1]) + (sine_other >= OFF[2]);
    }
}

WIDE static double sum_of_roots(const double *squared, ptrdiff_t n)
{
    double sums[8] = {0};
    ptrdiff_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (int k = 0; k < 8; k++)
            sums[k] += sqrt(squared[i + k]);
    for (; i < n; i++)
        sums[0] += sqrt(squared[i]);
    return sums[0] + sums[1] + sums[2] + sums[3] + sums[4] + sums[5] + sums[6] + sums[7];
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

int surface_forms(const float *cloud, ptrdiff_t n, double *out)
{
    const int count = n < NEIGHBOURS ? (int)n : NEIGHBOURS;
    double *const memory = malloc((size_t)n * ((14 + (size_t)n) * sizeof(double) + 3 * sizeof(int32_t)));
    if (!memory)
        return 0;
    double(*const points)[3] = (double(*)[3])memory;
    double *const x = memory + 3 * n, *const y = x + n, *const z = y + n; /* the same points, a row an axis */
    double *const u = z + n, *const v = u + n, *const w = v + n;          /* the normals */
    double *const bend = w + n, *const line = bend + n, *const facing = line + n; /* facing: 3 n */
    double *const squared = facing + 3 * n;                                       /* n rows of n */
    int32_t *const inclined = (int32_t *)(squared + n * n), *const off = inclined + n, *const off_other = off + n;
    double mean[3] = {0, 0, 0}, values[3], axes[3][3];
    for (ptrdiff_t i = 0; i < 3 * n; i++)
        mean[i % 3] += cloud[i] / (double)n;
    for (ptrdiff_t i = 0; i < n; i++) {
        x[i] = points[i][0] = cloud[3 * i] - mean[0];
        y[i] = points[i][1] = cloud[3 * i + 1] - mean[1];
        z[i] = points[i][2] = cloud[3 * i + 2] - mean[2];
    }
    plane((const double(*)[3])points, NULL, (int)n, values, axes);

    for (int k = 0; k < 3; k++) {
        const double *const axis = axes[2 - k];
        double low = 1e300, high = -1e300, second = 0, third = 0, fourth = 0;
        for (ptrdiff_t i = 0; i < n; i++) {
            const double at = dot(points[i], axis);
            low = at < low ? at : low;
            high = at > high ? at : high;
            second += at * at / (double)n;
            third += at * at * at / (double)n;
            fourth += at * at * at * at / (double)n;
        }
        second += FLAT;
        out[k] = log(high - low + LEAST);
        out[3 + k] = fabs(third) / (second * sqrt(second));
        out[6 + k] = fourth / (second * second);
    }

    double mean_distance = 0;
    for (ptrdiff_t i = 0; i < n; i++) {
        int near[NEIGHBOURS];
        double vectors[3][3];
        distances(x, y, z, n, i, squared + i * n);
        mean_distance += sum_of_roots(squared + i * n, i);
        nearest(squared + i * n, n, count, near);
        plane((const double(*)[3])points, near, count, values, vectors);
        u[i] = vectors[0][0];
        v[i] = vectors[0][1];
        w[i] = vectors[0][2];
        bend[i] = sqrt(values[0] / (values[0] + values[1] + values[2] + FLAT));
        line[i] = sqrt(values[1] / (values[2] + FLAT));
        for (int k = 0; k < 3; k++)
            facing[k * n + i] = fabs(dot(vectors[0], axes[2 - k]));
    }
    mean_distance /= (double)(n * (n - 1) / 2);
    mean_distance = mean_distance > 1e-9 ? mean_distance : 1e-9;

    double pairs[2][20] = {{0}};
    for (ptrdiff_t i = 1; i < n; i++) {
        bins(x, y, z, u, v, w, i, squared + i * n, mean_distance, inclined, off, off_other);
        for (ptrdiff_t j = 0; j < i; j++) {
            pairs[0][inclined[j]] += 2;
            pairs[1][off[j]] += 1;
            pairs[1][off_other[j]] += 1;
        }
    }
    double *to = out + 9;
    for (int which = 0; which < 2; which++)
        for (int far = 0; far < 5; far++) {
            const double *const row = pairs[which] + 4 * far;
            const double sum = row[0] + row[1] + row[2] + row[3];
            for (int k = 0; k < 4; k++)
                *to++ = row[k] / (sum > 1 ? sum : 1);
        }
    to = quantiles(bend, n, 7, to);
    to = quantiles(line, n, 7, to);
    for (int k = 0; k < 3; k++)
        to = quantiles(facing + k * n, n, 5, to);
    free(memory);
    return 1;
}
