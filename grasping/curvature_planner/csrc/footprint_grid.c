/* Points in square cells of the plane, so that those in a turned rectangle are found without looking at all of them. */
#include "planner.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double LEAST_CELL = 0.004, IN_A_CELL = 8.0; /* m; points, of a cloud that is spread evenly */
static const double SLACK = 1e-6; /* m, more than rounding moves a point of an object's size */

/* The whole number below a number of cells, within 0 … count − 1. */
static ptrdiff_t within(double cells, ptrdiff_t count)
{
    return cells > 0.0 ? (ptrdiff_t)least(cells, (double)(count - 1)) : 0;
}

int lay_out(Points points, FootprintGrid *grid)
{
    double low_x = INFINITY, low_y = INFINITY, high_x = -INFINITY, high_y = -INFINITY;
    for (ptrdiff_t i = 0; i < points.count; i++) {
        low_x = least(low_x, points.x[i]);
        high_x = greatest(high_x, points.x[i]);
        low_y = least(low_y, points.y[i]);
        high_y = greatest(high_y, points.y[i]);
    }
    const double wide = high_x - low_x, high = high_y - low_y;
    const double sparse = sqrt(wide * high * (IN_A_CELL / (double)points.count));
    const double cell = greatest(greatest(LEAST_CELL, sparse), greatest(wide, high) / (MOST_LINES - 1));
    *grid = (FootprintGrid){{NULL, NULL, NULL, points.count}, NULL, 0, 0, low_x, low_y, cell};
    grid->columns = within(wide / cell, MOST_LINES) + 1;
    grid->lines = within(high / cell, MOST_LINES) + 1;
    const size_t count = (size_t)points.count, cells = (size_t)(grid->lines * grid->columns);
    if (count > SIZE_MAX / (4 * sizeof(double)) - cells)
        return OUT_OF_MEMORY;
    double *memory = malloc(3 * count * sizeof(double) + (cells + 1 + count) * sizeof(ptrdiff_t));
    if (!memory)
        return OUT_OF_MEMORY;
    double *x = memory, *y = x + count, *height = y + count;
    ptrdiff_t *starts = (ptrdiff_t *)(height + count), *cell_of = starts + cells + 1;
    memset(starts, 0, (cells + 1) * sizeof(ptrdiff_t));
    for (size_t i = 0; i < count; i++) {
        cell_of[i] = within((points.y[i] - low_y) / cell, grid->lines) * grid->columns +
                     within((points.x[i] - low_x) / cell, grid->columns);
        starts[cell_of[i]]++;
    }
    ptrdiff_t sum = 0;
    for (size_t i = 0; i <= cells; i++) {
        const ptrdiff_t number = starts[i];
        starts[i] = sum;
        sum += number;
    }
    for (size_t i = 0; i < count; i++) {
        const ptrdiff_t to = starts[cell_of[i]]++;
        x[to] = points.x[i];
        y[to] = points.y[i];
        height[to] = points.height[i];
    }
    memmove(starts + 1, starts, cells * sizeof(ptrdiff_t)); /* each is now where the next cell starts */
    starts[0] = 0;
    grid->points = (Points){x, y, height, points.count};
    grid->starts = starts;
    return 0;
}

void discard(FootprintGrid *grid)
{
    free((double *)grid->points.x);
    grid->points.x = NULL;
}

/* Cut a range to where |slope · it + offset| stays within `most`, for an offset anywhere in between. */
static void narrow(double slope, double offset_low, double offset_high, double most, double *from, double *to)
{
    if (!(fabs(slope) > 1e-9))
        return;
    const double one = (-most - offset_high) / slope, other = (most - offset_low) / slope;
    *from = greatest(*from, least(one, other));
    *to = least(*to, greatest(one, other));
}

int spans_in(
    const FootprintGrid *grid, double x, double y, double cosine, double sine, double start, double end, double half,
    Span spans[MOST_LINES])
{
    if (!grid->points.count)
        return 0;
    const double middle = 0.5 * (start + end), length = 0.5 * (end - start) + SLACK, width = half + SLACK;
    const double at_x = x + cosine * middle - grid->x, at_y = y + sine * middle - grid->y;
    const double wide = fabs(cosine) * length + fabs(sine) * width, high = fabs(sine) * length + fabs(cosine) * width;
    const ptrdiff_t last = within((at_y + high) / grid->cell, grid->lines);
    int count = 0;
    for (ptrdiff_t line = within((at_y - high) / grid->cell, grid->lines); line <= last; line++) {
        const double low = greatest((double)line * grid->cell - SLACK - at_y, -high);
        const double up = least((double)(line + 1) * grid->cell + SLACK - at_y, high);
        double from = -wide, to = wide;
        narrow(cosine, least(sine * low, sine * up), greatest(sine * low, sine * up), length, &from, &to);
        narrow(sine, -greatest(cosine * low, cosine * up), -least(cosine * low, cosine * up), width, &from, &to);
        if (from > to || at_x + to < -SLACK)
            continue;
        const ptrdiff_t *starts = grid->starts + line * grid->columns;
        const Span span = {starts[within((at_x + from - SLACK) / grid->cell, grid->columns)],
                           starts[within((at_x + to + SLACK) / grid->cell, grid->columns) + 1]};
        if (span.first < span.stop)
            spans[count++] = span;
    }
    return count;
}
