/* survey.survey: slabs across the long axis, their parts, and the surface variation at their sides. */
#include "_kernels.h"

#include <math.h>
#include <stdlib.h>

enum { NEIGHBOURS = 10, THINNED = 150 };
static const double PART_GAP = 0.010, LEAST_CELL = 0.002;
static const double PI = 3.14159265358979323846;

typedef struct {
    double x, y, z;
} Point;

static double least(double a, double b) { return b < a ? b : a; }
static double greatest(double a, double b) { return b > a ? b : a; }

/* σ of the covariance of k points: `curvature.smallest_eigenvalue_share`. */
static double variation(const Point *points, int k)
{
    double x = 0.0, y = 0.0, z = 0.0, xx = 0.0, yy = 0.0, zz = 0.0, xy = 0.0, xz = 0.0, yz = 0.0;
    for (int i = 0; i < k; i++) {
        x += points[i].x;
        y += points[i].y;
        z += points[i].z;
    }
    x /= k;
    y /= k;
    z /= k;
    for (int i = 0; i < k; i++) {
        const double dx = points[i].x - x, dy = points[i].y - y, dz = points[i].z - z;
        xx += dx * dx;
        yy += dy * dy;
        zz += dz * dz;
        xy += dx * dy;
        xz += dx * dz;
        yz += dy * dz;
    }
    xx /= k;
    yy /= k;
    zz /= k;
    xy /= k;
    xz /= k;
    yz /= k;
    const double trace = xx + yy + zz, mean = trace / 3.0;
    const double b00 = xx - mean, b11 = yy - mean, b22 = zz - mean;
    const double square = (b00 * b00 + b11 * b11 + b22 * b22 + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0;
    const double p = sqrt(square), cubed = p * square;
    const double half_determinant =
        0.5 * (b00 * (b11 * b22 - yz * yz) - xy * (xy * b22 - yz * xz) + xz * (xy * yz - b11 * xz));
    const double ratio = cubed > 1e-300 ? greatest(least(half_determinant / cubed, 1.0), -1.0) : 0.0;
    const double smallest = mean + 2.0 * p * cos(acos(ratio) / 3.0 + 2.0 * PI / 3.0);
    return trace > 1e-300 ? greatest(least(smallest / trace, 1.0 / 3.0), 0.0) : 0.0;
}

/* σ of the nearest of the points, of equally near ones those with the lower index. */
static double variation_at(const Point *points, ptrdiff_t count, Point query)
{
    Point nearest[NEIGHBOURS];
    double distance[NEIGHBOURS];
    int k = 0;
    for (ptrdiff_t i = 0; i < count; i++) {
        const double dx = points[i].x - query.x, dy = points[i].y - query.y, dz = points[i].z - query.z;
        const double square = dx * dx + dy * dy + dz * dz;
        if (k == NEIGHBOURS && !(square < distance[k - 1]))
            continue;
        int at = k < NEIGHBOURS ? k++ : k - 1;
        for (; at > 0 && square < distance[at - 1]; at--) {
            distance[at] = distance[at - 1];
            nearest[at] = nearest[at - 1];
        }
        distance[at] = square;
        nearest[at] = points[i];
    }
    return k < 3 ? 0.0 : variation(nearest, k);
}

/* The last point, hence the highest, in each square cell of the plane; `into` must hold all. */
static ptrdiff_t thin(Points points, double x0, double y0, double x1, double y1, double cell, Point *into)
{
    const double across = floor((x1 - x0) / cell) + 1.0, along = floor((y1 - y0) / cell) + 1.0;
    if (!(across >= 1.0 && along >= 1.0 && across * along < 1e8))
        return TOO_LARGE;
    const ptrdiff_t lines = (ptrdiff_t)across, columns = (ptrdiff_t)along;
    ptrdiff_t *last = malloc((size_t)lines * (size_t)columns * sizeof(ptrdiff_t));
    if (!last)
        return OUT_OF_MEMORY;
    for (ptrdiff_t i = 0; i < lines * columns; i++)
        last[i] = -1;
    for (ptrdiff_t i = 0; i < points.count; i++) {
        const double line = least((points.x[i] - x0) / cell, across - 1.0);
        const double column = least((points.y[i] - y0) / cell, along - 1.0);
        last[(line > 0.0 ? (ptrdiff_t)line : 0) * columns + (column > 0.0 ? (ptrdiff_t)column : 0)] = i;
    }
    ptrdiff_t count = 0;
    for (ptrdiff_t i = 0; i < lines * columns; i++)
        if (last[i] >= 0)
            into[count++] = (Point){points.x[last[i]], points.y[last[i]], points.height[last[i]]};
    free(last);
    return count;
}

/* Sort indices by slab and then along x; equal ones keep their order (merge sort from short runs up). */
static void sort_by_slab(int64_t *order, int64_t *spare, ptrdiff_t count, const double *slab, const double *x)
{
    int64_t *from = order, *to = spare;
    for (ptrdiff_t run = 1; run < count; run *= 2) {
        for (ptrdiff_t start = 0; start < count; start += 2 * run) {
            const ptrdiff_t middle = start + run < count ? start + run : count;
            const ptrdiff_t stop = middle + run < count ? middle + run : count;
            ptrdiff_t a = start, b = middle;
            for (ptrdiff_t i = start; i < stop; i++) {
                int second = a == middle;
                if (!second && b < stop) {
                    const double one = slab[from[a]], other = slab[from[b]];
                    second = other < one || (other == one && x[from[b]] < x[from[a]]);
                }
                to[i] = from[second ? b++ : a++];
            }
        }
        int64_t *swap = from;
        from = to;
        to = swap;
    }
    for (ptrdiff_t i = 0; from != order && i < count; i++)
        order[i] = from[i];
}

static ptrdiff_t add_part(
    int64_t *parts, ptrdiff_t found, double slab, ptrdiff_t cluster, ptrdiff_t start, ptrdiff_t stop)
{
    if (stop - start < 3)
        return found;
    int64_t *part = parts + PART_COUNTS * found;
    part[PART_SLAB] = (int64_t)slab;
    part[PART_CLUSTER] = cluster;
    part[PART_START] = start;
    part[PART_STOP] = stop;
    return found + 1;
}

/* Slabs and, of those that fall apart along x, the parts from the left; each of three points or more. */
static ptrdiff_t cut(const int64_t *order, ptrdiff_t count, const double *slab, const double *x, int64_t *parts)
{
    ptrdiff_t found = 0;
    for (ptrdiff_t start = 0, stop; start < count; start = stop) {
        const double number = slab[order[start]];
        ptrdiff_t gaps = 0;
        for (stop = start + 1; stop < count && slab[order[stop]] == number; stop++)
            gaps += x[order[stop]] - x[order[stop - 1]] > PART_GAP;
        found = add_part(parts, found, number, -1, start, stop);
        for (ptrdiff_t cluster = 0, from = start, to; gaps > 0 && cluster <= gaps; cluster++, from = to) {
            for (to = from + 1; to < stop && !(x[order[to]] - x[order[to - 1]] > PART_GAP);)
                to++;
            found = add_part(parts, found, number, cluster, from, to);
        }
    }
    return found;
}

/* Bounds, lateral curvature, flat share and whether a hold lies in it, of one part. */
static void measure(
    Points object, const int64_t *order, const Point *thinned, const double *sigma, ptrdiff_t thinned_count,
    const double *hold_x, const double *hold_y, ptrdiff_t hold_count, double flat, int64_t *part, double *measures)
{
    const int64_t first = order[part[PART_START]], last = order[part[PART_STOP] - 1];
    const double low_x = object.x[first], high_x = object.x[last];
    double low_y = object.y[first], high_y = low_y;
    for (int64_t i = part[PART_START] + 1; i < part[PART_STOP]; i++) {
        low_y = least(low_y, object.y[order[i]]);
        high_y = greatest(high_y, object.y[order[i]]);
    }
    part[PART_FLAT] = part[PART_SEEN] = part[PART_HELD] = 0;
    for (ptrdiff_t i = 0; i < thinned_count; i++)
        if (thinned[i].x >= low_x && thinned[i].x <= high_x && thinned[i].y >= low_y && thinned[i].y <= high_y) {
            part[PART_SEEN]++;
            part[PART_FLAT] += sigma[i] <= flat;
        }
    for (ptrdiff_t i = 0; i < hold_count && !part[PART_HELD]; i++)
        part[PART_HELD] = hold_x[i] >= low_x && hold_x[i] <= high_x && hold_y[i] >= low_y && hold_y[i] <= high_y;
    const Point start = {object.x[first], object.y[first], object.height[first]};
    const Point stop = {object.x[last], object.y[last], object.height[last]};
    measures[PART_LOW_X] = low_x;
    measures[PART_LOW_Y] = low_y;
    measures[PART_HIGH_X] = high_x;
    measures[PART_HIGH_Y] = high_y;
    measures[PART_CURVATURE] =
        variation_at(thinned, thinned_count, start) + variation_at(thinned, thinned_count, stop);
}

static ptrdiff_t survey_with(
    Points object, const double *hold_x, const double *hold_y, ptrdiff_t hold_count, double slab_height, double flat,
    int64_t *order, int64_t *parts, double *measures, int64_t *spare, double *slab, double *sigma, Point *thinned)
{
    double left = object.x[0], right = left, bottom = object.y[0], top = bottom;
    for (ptrdiff_t i = 1; i < object.count; i++) {
        left = least(left, object.x[i]);
        right = greatest(right, object.x[i]);
        bottom = least(bottom, object.y[i]);
        top = greatest(top, object.y[i]);
    }
    const double cell = greatest(sqrt((right - left) * (top - bottom) / THINNED), LEAST_CELL);
    const ptrdiff_t thinned_count = thin(object, left, bottom, right, top, cell, thinned);
    if (thinned_count < 0)
        return thinned_count;
    for (ptrdiff_t i = 0; i < thinned_count; i++)
        sigma[i] = variation_at(thinned, thinned_count, thinned[i]);
    const double length = greatest(top - bottom, 1e-9);
    const double slabs = greatest(least(nearbyint(length / slab_height), 1e6), 1.0);
    for (ptrdiff_t i = 0; i < object.count; i++) {
        const double number = least((top - object.y[i]) * (slabs / length), slabs - 1.0);
        slab[i] = number > 0.0 ? floor(number) : 0.0;
        order[i] = i;
    }
    sort_by_slab(order, spare, object.count, slab, object.x);
    const ptrdiff_t found = cut(order, object.count, slab, object.x, parts);
    for (ptrdiff_t i = 0; i < found; i++)
        measure(object, order, thinned, sigma, thinned_count, hold_x, hold_y, hold_count, flat, parts + PART_COUNTS * i,
                measures + PART_MEASURES * i);
    return found;
}

ptrdiff_t survey_regions(
    Points object, const double *hold_x, const double *hold_y, ptrdiff_t hold_count, double slab_height, double flat,
    int64_t *order, int64_t *parts, double *measures)
{
    const size_t count = (size_t)object.count;
    if (!count)
        return 0;
    if (count > SIZE_MAX / sizeof(Point))
        return OUT_OF_MEMORY;
    int64_t *spare = malloc(count * sizeof(int64_t));
    double *slab = malloc(count * sizeof(double)), *sigma = malloc(count * sizeof(double));
    Point *thinned = malloc(count * sizeof(Point));
    ptrdiff_t found = OUT_OF_MEMORY;
    if (spare && slab && sigma && thinned)
        found = survey_with(object, hold_x, hold_y, hold_count, slab_height, flat, order, parts, measures, spare, slab,
                            sigma, thinned);
    free(spare);
    free(slab);
    free(sigma);
    free(thinned);
    return found;
}
