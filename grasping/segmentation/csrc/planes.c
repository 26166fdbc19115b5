/* See planes.py: planes drawn through points, and refined on the points near them. */
#include "segmentation.h"
#include "selection.h"
#include "symmetric.h"

#include <math.h>
#include <stdlib.h>

enum { REFINEMENTS = 8, LEAST_INLIERS = 10 };
#define LEAST_NORMAL 1e-6
#define SETTLED 0.002

SELECTION(select_double, double)

/* The two of a row's points that are nearest to `from`, the nearest first. */
static void find_nearest(const double *points, const double *from, const int64_t *row, int64_t nearest[2])
{
    double least[2] = {INFINITY, INFINITY};
    nearest[0] = nearest[1] = row[0];
    for (int k = 0; k < NEARBY; k++) {
        const double *to = points + 3 * row[k], x = to[0] - from[0], y = to[1] - from[1], z = to[2] - from[2];
        const double squared = x * x + y * y + z * z;
        if (squared < least[0]) {
            least[1] = least[0];
            nearest[1] = nearest[0];
            least[0] = squared;
            nearest[0] = row[k];
        } else if (squared < least[1]) {
            least[1] = squared;
            nearest[1] = row[k];
        }
    }
}

/* The plane through three points; whether they span one, and one that is level enough where `up` is known. */
static int span(const double *a, const double *b, const double *c, const double *up, double least_cosine, double plane[4])
{
    const double one[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, other[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    double n[3];
    for (int k = 0; k < 3; k++)
        n[k] = one[(k + 1) % 3] * other[(k + 2) % 3] - one[(k + 2) % 3] * other[(k + 1) % 3];
    const double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (!(length > LEAST_NORMAL))
        return 0;
    if (up && !(fabs(n[0] * up[0] + n[1] * up[1] + n[2] * up[2]) > least_cosine * length))
        return 0;
    for (int k = 0; k < 3; k++)
        plane[k] = n[k] / length;
    plane[3] = -(plane[0] * a[0] + plane[1] * a[1] + plane[2] * a[2]);
    return 1;
}

static void level_through(const double *a, const double *up, double plane[4])
{
    memcpy(plane, up, 3 * sizeof(*up));
    plane[3] = -(up[0] * a[0] + up[1] * a[1] + up[2] * a[2]);
}

/* How many of the tested points, by coordinate, are near a plane. */
static ptrdiff_t count_near(const double *tested, ptrdiff_t count, const double plane[4], double distance)
{
    const double *x = tested, *y = tested + count, *z = tested + 2 * count;
    int64_t near = 0;
    for (ptrdiff_t i = 0; i < count; i++)
        near += fabs(plane[0] * x[i] + plane[1] * y[i] + plane[2] * z[i] + plane[3]) < distance;
    return (ptrdiff_t)near;
}

static int are_in_range(const int64_t *index, ptrdiff_t count, ptrdiff_t points)
{
    for (ptrdiff_t i = 0; i < count; i++)
        if (index[i] < 0 || index[i] >= points)
            return 0;
    return 1;
}

int draw_plane(const double *points, ptrdiff_t count, const Draws *draws, const double *up, double least_cosine,
               double distance, double best[4])
{
    if (!are_in_range(draws->corners, 3 * draws->hypotheses, count) ||
        !are_in_range(draws->drawn, NEARBY * draws->half, count) || !are_in_range(draws->tested, draws->tests, count))
        return OUT_OF_RANGE;
    double *tested = malloc((size_t)(3 * draws->tests + 1) * sizeof(*tested));
    int64_t *through = malloc((size_t)(draws->hypotheses + 1) * sizeof(*through)); /* each hypothesis' second point */
    if (!tested || !through) {
        free(tested);
        free(through);
        return OUT_OF_MEMORY;
    }
    for (ptrdiff_t i = 0; i < draws->tests; i++)
        for (int k = 0; k < 3; k++)
            tested[k * draws->tests + i] = points[3 * draws->tested[i] + k];
    ptrdiff_t most = -1;
    for (ptrdiff_t i = 0; i < draws->hypotheses; i++) {
        const int64_t *corner = draws->corners + 3 * i;
        int64_t others[2] = {corner[1], corner[2]};
        if (i < draws->half)
            find_nearest(points, points + 3 * corner[0], draws->drawn + NEARBY * i, others);
        through[i] = others[0];
        double plane[4];
        if (!span(points + 3 * corner[0], points + 3 * others[0], points + 3 * others[1], up, least_cosine, plane))
            continue;
        const ptrdiff_t near = count_near(tested, draws->tests, plane, distance);
        if (near > most) {
            most = near;
            memcpy(best, plane, sizeof(plane));
        }
    }
    for (ptrdiff_t i = 0; up && i < draws->level && i < draws->hypotheses; i++) {
        double plane[4];
        level_through(points + 3 * through[i], up, plane);
        const ptrdiff_t near = count_near(tested, draws->tests, plane, distance);
        if (near > most) {
            most = near;
            memcpy(best, plane, sizeof(plane));
        }
    }
    free(tested);
    free(through);
    return most >= 0;
}

/* Along which a symmetric matrix is least. */
static void find_least_axis(const double half[6], double axis[3])
{
    double values[3], axes[3][3];
    find_axes(half, values, axes);
    int least = values[1] < values[0] ? 1 : 0;
    least = values[2] < values[least] ? 2 : least;
    for (int k = 0; k < 3; k++)
        axis[k] = axes[k][least];
}

/* Of `count` numbers, which are put into another order. */
static double find_median(double *values, ptrdiff_t count)
{
    const double upper = select_double(values, 0, count - 1, count / 2);
    if (count & 1)
        return upper;
    double lower = values[0];
    for (ptrdiff_t i = 1; i < count / 2; i++)
        lower = values[i] > lower ? values[i] : lower;
    return (lower + upper) / 2.0;
}

/* Fit the plane to `count` inliers, which become those about their mean. left: room for count numbers. */
static double fit_plane(double *inliers, ptrdiff_t count, double plane[4], double *left)
{
    double mean[3] = {0.0, 0.0, 0.0}, half[6] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0}, n[3];
    for (ptrdiff_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++)
            mean[k] += inliers[3 * i + k];
    for (int k = 0; k < 3; k++)
        mean[k] /= (double)count;
    for (ptrdiff_t i = 0; i < count; i++) {
        double *at = inliers + 3 * i;
        for (int k = 0; k < 3; k++)
            at[k] -= mean[k];
        half[0] += at[0] * at[0];
        half[1] += at[0] * at[1];
        half[2] += at[0] * at[2];
        half[3] += at[1] * at[1];
        half[4] += at[1] * at[2];
        half[5] += at[2] * at[2];
    }
    find_least_axis(half, n);
    const double side = n[0] * plane[0] + n[1] * plane[1] + n[2] * plane[2] < 0.0 ? -1.0 : 1.0;
    for (int k = 0; k < 3; k++)
        plane[k] = n[k] * side;
    plane[3] = -(plane[0] * mean[0] + plane[1] * mean[1] + plane[2] * mean[2]);
    for (ptrdiff_t i = 0; i < count; i++)
        left[i] = fabs(inliers[3 * i] * plane[0] + inliers[3 * i + 1] * plane[1] + inliers[3 * i + 2] * plane[2]);
    return 1.4826 * find_median(left, count);
}

int refine_plane(const double *points, ptrdiff_t count, const double band[2], double *plane, double *width, double *residual)
{
    double *inliers = malloc((size_t)(4 * count + 1) * sizeof(*inliers));
    if (!inliers)
        return OUT_OF_MEMORY;
    *residual = *width;
    for (int time = 0; time < REFINEMENTS; time++) {
        ptrdiff_t near = 0;
        for (ptrdiff_t i = 0; i < count; i++) {
            const double *at = points + 3 * i;
            memcpy(inliers + 3 * near, at, 3 * sizeof(*at));
            near += fabs(at[0] * plane[0] + at[1] * plane[1] + at[2] * plane[2] + plane[3]) <= *width;
        }
        if (near < LEAST_INLIERS)
            break;
        *residual = fit_plane(inliers, near, plane, inliers + 3 * count);
        const double last = *width, wide = 3.0 * *residual;
        *width = wide < band[0] ? band[0] : wide > band[1] ? band[1] : wide;
        if (fabs(last - *width) < SETTLED * *width)
            break;
    }
    free(inliers);
    return 0;
}
