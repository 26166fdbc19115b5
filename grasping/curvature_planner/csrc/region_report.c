/* region_report.measure_regions: slabs across the long axis, their parts, and the surface variation at their sides. */
#include "planner.h"

#include <math.h>
#include <stdlib.h>

enum { NEIGHBOURS = 10, THINNED = 150 };
static const double PART_GAP = 0.010, LEAST_CELL = 0.002;

typedef struct {
    double x, y, z;
} Point;

/* σ of the covariance of k points: `curvature.smallest_eigenvalue_share`. */
static double variation(const Point *all, const ptrdiff_t *nearest, int k)
{
    Point points[NEIGHBOURS];
    double x = 0.0, y = 0.0, z = 0.0, xx = 0.0, yy = 0.0, zz = 0.0, xy = 0.0, xz = 0.0, yz = 0.0;
    for (int i = 0; i < k; i++) {
        points[i] = all[nearest[i]];
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

typedef struct {
    double square[NEIGHBOURS]; /* of the distance, rising */
    ptrdiff_t index[NEIGHBOURS];
    int count;
} Nearest;

/* Of equally near points the one with the lower index comes first, in whatever order they are put in. */
static void put(Nearest *nearest, double square, ptrdiff_t index)
{
    int at = nearest->count;
    if (at == NEIGHBOURS && square == nearest->square[at - 1] && index > nearest->index[at - 1])
        return;
    if (at == NEIGHBOURS)
        at--;
    else
        nearest->count++;
    for (; at > 0; at--) {
        const double before = nearest->square[at - 1];
        if (square > before || (square == before && index > nearest->index[at - 1]))
            break;
        nearest->square[at] = before;
        nearest->index[at] = nearest->index[at - 1];
    }
    nearest->square[at] = square;
    nearest->index[at] = index;
}

/* Square cells of the plane, by lines along y: the index of the point in each, or −1. */
typedef struct {
    ptrdiff_t *point;
    ptrdiff_t lines, columns;
    double x, y, cell;
} Grid;

static ptrdiff_t line_of(const Grid *grid, double x)
{
    const double line = least((x - grid->x) / grid->cell, (double)(grid->lines - 1));
    return line > 0.0 ? (ptrdiff_t)line : 0;
}

static ptrdiff_t column_of(const Grid *grid, double y)
{
    const double column = least((y - grid->y) / grid->cell, (double)(grid->columns - 1));
    return column > 0.0 ? (ptrdiff_t)column : 0;
}

/* σ of the nearest of the grid's points, looked for in wider and wider rings of cells. */
static double variation_at(const Point *points, const Grid *grid, Point query)
{
    const ptrdiff_t line = line_of(grid, query.x), column = column_of(grid, query.y);
    const ptrdiff_t rings = grid->lines > grid->columns ? grid->lines : grid->columns;
    Nearest nearest;
    nearest.count = 0;
    for (ptrdiff_t ring = 0; ring < rings; ring++) {
        const ptrdiff_t top = line - ring, bottom = line + ring, left = column - ring, right = column + ring;
        for (ptrdiff_t i = top < 0 ? 0 : top; i <= bottom && i < grid->lines; i++) {
            const ptrdiff_t step = i == top || i == bottom ? 1 : 2 * ring;
            for (ptrdiff_t j = left < 0 && step == 1 ? 0 : left; j <= right && j < grid->columns; j += step) {
                const ptrdiff_t at = j < 0 ? -1 : grid->point[i * grid->columns + j];
                if (at < 0)
                    continue;
                const double dx = points[at].x - query.x, dy = points[at].y - query.y, dz = points[at].z - query.z;
                const double square = dx * dx + dy * dy + dz * dz;
                if (nearest.count < NEIGHBOURS || square <= nearest.square[NEIGHBOURS - 1])
                    put(&nearest, square, at);
            }
        }
        const double beyond = 0.999 * (double)ring * grid->cell; /* nothing in the rings left is nearer than that */
        if (nearest.count == NEIGHBOURS && nearest.square[NEIGHBOURS - 1] < beyond * beyond)
            break;
    }
    return nearest.count < 3 ? 0.0 : variation(points, nearest.index, nearest.count);
}

/* The last point, hence the highest, in each cell of a new grid; `into` must hold all. Returns their number. */
static ptrdiff_t thin(Points points, double x1, double y1, Grid *grid, Point *into)
{
    const double lines = floor((x1 - grid->x) / grid->cell) + 1.0, columns = floor((y1 - grid->y) / grid->cell) + 1.0;
    if (!(lines >= 1.0 && columns >= 1.0 && lines * columns < 1e8))
        return TOO_LARGE;
    grid->lines = (ptrdiff_t)lines;
    grid->columns = (ptrdiff_t)columns;
    const ptrdiff_t cells = grid->lines * grid->columns;
    grid->point = malloc((size_t)cells * sizeof(ptrdiff_t));
    if (!grid->point)
        return OUT_OF_MEMORY;
    for (ptrdiff_t i = 0; i < cells; i++)
        grid->point[i] = -1;
    for (ptrdiff_t i = 0; i < points.count; i++)
        grid->point[line_of(grid, points.x[i]) * grid->columns + column_of(grid, points.y[i])] = i;
    ptrdiff_t count = 0;
    for (ptrdiff_t i = 0; i < cells; i++) {
        const ptrdiff_t last = grid->point[i];
        if (last < 0)
            continue;
        into[count] = (Point){points.x[last], points.y[last], points.height[last]};
        grid->point[i] = count++;
    }
    return count;
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
    Points object, const int64_t *order, const Grid *grid, const Point *thinned, const double *sigma, ptrdiff_t thinned_count,
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
        variation_at(thinned, grid, start) + variation_at(thinned, grid, stop);
}

static ptrdiff_t survey_with(
    Points object, const double *hold_x, const double *hold_y, ptrdiff_t hold_count, double slab_height, double flat,
    int64_t *order, int64_t *parts, double *measures, int64_t *spare, uint64_t *bits, double *slab,
    double *sigma, Point *thinned)
{
    double left = object.x[0], right = left, bottom = object.y[0], top = bottom;
    for (ptrdiff_t i = 1; i < object.count; i++) {
        left = least(left, object.x[i]);
        right = greatest(right, object.x[i]);
        bottom = least(bottom, object.y[i]);
        top = greatest(top, object.y[i]);
    }
    const double cell = greatest(sqrt((right - left) * (top - bottom) / THINNED), LEAST_CELL);
    Grid grid = {NULL, 0, 0, left, bottom, cell};
    const ptrdiff_t thinned_count = thin(object, right, top, &grid, thinned);
    if (thinned_count < 0)
        return thinned_count;
    for (ptrdiff_t i = 0; i < thinned_count; i++)
        sigma[i] = variation_at(thinned, &grid, thinned[i]);
    const double length = greatest(top - bottom, 1e-9);
    const double slabs = greatest(least(nearbyint(length / slab_height), 1e6), 1.0);
    for (ptrdiff_t i = 0; i < object.count; i++) {
        const double number = least((top - object.y[i]) * (slabs / length), slabs - 1.0);
        slab[i] = number > 0.0 ? floor(number) : 0.0;
        order[i] = i;
    }
    sort_indices(object.x, object.count, order, spare, bits);
    sort_indices(slab, object.count, order, spare, bits);
    const ptrdiff_t found = cut(order, object.count, slab, object.x, parts);
    for (ptrdiff_t i = 0; i < found; i++)
        measure(object, order, &grid, thinned, sigma, thinned_count, hold_x, hold_y, hold_count, flat, parts + PART_COUNTS * i,
                measures + PART_MEASURES * i);
    free(grid.point);
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
    uint64_t *bits = malloc(count * sizeof(uint64_t));
    double *slab = malloc(count * sizeof(double)), *sigma = malloc(count * sizeof(double));
    Point *thinned = malloc(count * sizeof(Point));
    ptrdiff_t found = OUT_OF_MEMORY;
    if (spare && bits && slab && sigma && thinned)
        found = survey_with(object, hold_x, hold_y, hold_count, slab_height, flat, order, parts, measures, spare, bits,
                            slab, sigma, thinned);
    free(spare);
    free(bits);
    free(slab);
    free(sigma);
    free(thinned);
    return found;
}
