/* unseen_back.py: the back of an object that was seen from one side. */
#include "planner.h"

#include <math.h>
#include <stdlib.h>

enum { TRIED = 6, MOST_SEEN = 10 };
static const double MOST_CELLS = 120.0, AGREES = 0.010, BELOW = 0.005, STEP = 0.010, LEAST_HEIGHT = 0.005;
static const double ABOVE = 0.2;
static const double NO_FINGER_ENTERS = 0.010, FILLED = 0.0075;

typedef struct {
    const Sight *sight;
    double x0, y0, cell, floor;
    ptrdiff_t lines, columns, last; /* of the footprint; the line to which the first one is turned */
    double *seen, *surface;         /* heights: (lines, columns) and (last + 1, columns) */
    double *found;                  /* (capacity, 3) */
    ptrdiff_t count, capacity;
} Back;

/* The height at and below this one, in steps, at which a place is hidden. */
static double lowered(const Back *back, double x, double y, double height)
{
    const double floor = back->floor + LEAST_HEIGHT;
    for (ptrdiff_t step = 0;; step++) {
        const double tried = height - STEP * (double)step;
        if (!(tried > floor))
            return -INFINITY;
        if (doubt(back->sight, x, y, tried))
            return tried;
    }
}

static void emit(Back *back, double x, double y, double height)
{
    if (back->count == back->capacity)
        return;
    double *to = back->found + 3 * back->count++;
    to[0] = x;
    to[1] = y;
    to[2] = height;
}

static ptrdiff_t turned_about(const Back *back, ptrdiff_t deep)
{
    const ptrdiff_t near = back->lines - 1, far = deep > near ? deep : near;
    for (ptrdiff_t k = 0; far > near && k < TRIED; k++) {
        const ptrdiff_t last = far - (far - near) * k / TRIED;
        ptrdiff_t all = 0, against = 0;
        for (ptrdiff_t i = 0; i < back->lines; i++)
            for (ptrdiff_t j = 0; j < back->columns; j++) {
                const double h = back->seen[i * back->columns + j];
                if (!(h > -INFINITY))
                    continue;
                all++;
                const ptrdiff_t line = last - i, column = back->columns - 1 - j;
                if (line < back->lines && back->seen[line * back->columns + column] >= h - AGREES)
                    continue;
                against += !doubt(back->sight, back->x0 + ((double)column + 0.5) * back->cell,
                                      back->y0 + ((double)line + 0.5) * back->cell, h - BELOW);
            }
        if (MOST_SEEN * against <= all)
            return last;
    }
    return near;
}

/* Fill the gaps of one line or column of the surface: cells `step` apart, `length` of them; (i, j) of the first one. */
static void fill(Back *back, ptrdiff_t i, ptrdiff_t j, int along, ptrdiff_t length, ptrdiff_t stride, ptrdiff_t least)
{
    const double *row = back->surface + i * back->columns + j;
    const ptrdiff_t step = along == 0 ? back->columns : 1;
    ptrdiff_t one = -1;
    for (ptrdiff_t other = 0; other < length; other++) {
        if (!(row[other * step] > -INFINITY))
            continue;
        if (one >= 0 && other - one - 1 >= least) {
            const double height = greatest(row[one * step], row[other * step]);
            const ptrdiff_t before = back->count;
            for (ptrdiff_t m = one + stride; m < other; m += stride) {
                const double x = back->x0 + ((double)(along == 0 ? j : m) + 0.5) * back->cell;
                const double y = back->y0 + ((double)(along == 0 ? m : i) + 0.5) * back->cell;
                const double under = lowered(back, x, y, height);
                if (!(under > -INFINITY)) {
                    back->count = before;
                    break;
                }
                emit(back, x, y, under);
            }
        }
        one = other;
    }
}

static ptrdiff_t assume_along(
    Points cloud, const double axes[9], double floor, const double image_up[2], double cell, const Sight *sight,
    double *found, ptrdiff_t capacity)
{
    const ptrdiff_t count = cloud.count;
    if ((size_t)count > SIZE_MAX / (3 * sizeof(double)))
        return OUT_OF_MEMORY;
    double *local = malloc(3 * (size_t)count * sizeof(double));
    if (!local)
        return OUT_OF_MEMORY;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    double lowest = INFINITY, highest = -INFINITY;
    for (ptrdiff_t i = 0; i < count; i++) {
        for (int axis = 0; axis < 3; axis++) {
            const double value = project_point(cloud, i, axes, axis);
            local[axis * count + i] = value;
            low[axis] = least(low[axis], value);
            high[axis] = greatest(high[axis], value);
        }
        const double upward = image_up[0] * local[count + i] + image_up[1] * local[2 * count + i];
        lowest = least(lowest, upward);
        highest = greatest(highest, upward);
    }
    const double *x = local, *y = local + count, *height = local + 2 * count;
    const double wide = high[0] - low[0], length = high[1] - low[1], tall = highest - lowest;
    const double deep = tall < wide ? tall : wide, longer = greatest(wide, length) / MOST_CELLS;
    cell = greatest(cell, longer);
    if (!(wide / cell <= MOST_CELLS + 1.0 && length / cell <= MOST_CELLS + 1.0 && deep / cell <= MOST_CELLS + 1.0)) {
        free(local);
        return TOO_LARGE;
    }
    Back back = {sight, low[0], low[1], cell, floor, (ptrdiff_t)(length / cell) + 1, (ptrdiff_t)(wide / cell) + 1, 0,
                 NULL, NULL, found, 0, capacity};
    const ptrdiff_t most = back.lines + (ptrdiff_t)(deep / cell) + 1, cells = back.lines * back.columns;
    double *heights = malloc((size_t)(cells + most * back.columns) * sizeof(double));
    ptrdiff_t *top = malloc((size_t)cells * sizeof(ptrdiff_t));
    if (heights && top) {
        back.seen = heights;
        back.surface = heights + cells;
        for (ptrdiff_t i = 0; i < cells; i++) {
            back.seen[i] = -INFINITY;
            top[i] = -1;
        }
        for (ptrdiff_t i = 0; i < count; i++) {
            const ptrdiff_t line = (ptrdiff_t)((y[i] - low[1]) / cell), column = (ptrdiff_t)((x[i] - low[0]) / cell);
            const ptrdiff_t at = (line < back.lines ? line : back.lines - 1) * back.columns +
                                 (column < back.columns ? column : back.columns - 1);
            if (height[i] >= back.seen[at]) {
                back.seen[at] = height[i];
                top[at] = i;
            }
        }
        back.last = turned_about(&back, (ptrdiff_t)(deep / cell));
        for (ptrdiff_t i = 0; i < (back.last + 1) * back.columns; i++)
            back.surface[i] = i < cells ? back.seen[i] : -INFINITY;
        for (ptrdiff_t i = 0; i < back.lines; i++)
            for (ptrdiff_t j = 0; j < back.columns; j++) {
                const ptrdiff_t from = top[i * back.columns + j], line = back.last - i, column = back.columns - 1 - j;
                if (from < 0 || (line < back.lines && back.seen[line * back.columns + column] > -INFINITY))
                    continue;
                const double at_x = (2.0 * low[0] + (double)back.columns * cell) - x[from];
                const double at_y = (2.0 * low[1] + (double)(back.last + 1) * cell) - y[from];
                const double under = lowered(&back, at_x, at_y, height[from]);
                if (under > -INFINITY) {
                    emit(&back, at_x, at_y, under);
                    back.surface[line * back.columns + column] = under;
                }
            }
        const ptrdiff_t by_width = (ptrdiff_t)(FILLED / cell), by_finger = (ptrdiff_t)(NO_FINGER_ENTERS / cell);
        const ptrdiff_t stride = by_width > 1 ? by_width : 1, gap = by_finger > 2 ? by_finger : 2;
        fill(&back, 0, 0, 0, back.last + 1, 1, gap); /* the sides densely: pads may touch them */
        fill(&back, 0, back.columns - 1, 0, back.last + 1, 1, gap);
        for (ptrdiff_t j = stride / 2; j < back.columns; j += stride)
            fill(&back, 0, j, 0, back.last + 1, stride, gap);
        for (ptrdiff_t i = stride / 2; i <= back.last; i += stride)
            fill(&back, i, 0, 1, back.columns, stride, gap);
    }
    const int failed = !(heights && top);
    free(local);
    free(heights);
    free(top);
    return failed ? OUT_OF_MEMORY : back.count;
}

static double dot(const double a[3], const double b[3]) { return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]; }

ptrdiff_t assume_back(
    Points cloud, const double up[3], double floor, double cell, const double *viewpoints, const Sight *sight,
    double *found, ptrdiff_t capacity)
{
    const double *rows[3] = {cloud.x, cloud.y, cloud.height}, eyes = (double)sight->count;
    double along[3], level[3];
    for (int axis = 0; axis < 3; axis++) {
        double low = INFINITY, high = -INFINITY, eye = 0.0;
        for (ptrdiff_t i = 0; i < cloud.count; i++) {
            low = least(low, rows[axis][i]);
            high = greatest(high, rows[axis][i]);
        }
        for (ptrdiff_t i = 0; i < sight->count; i++)
            eye += viewpoints[3 * i + axis];
        along[axis] = 0.5 * (low + high) - eye / eyes;
    }
    const double distance = sqrt(dot(along, along)), sinking = dot(along, up);
    double lens = INFINITY;
    for (ptrdiff_t i = 0; i < sight->count; i++)
        lens = least(lens, sight->lenses[LENS * i + 14]);
    for (int axis = 0; axis < 3; axis++)
        level[axis] = along[axis] - sinking * up[axis];
    const double size = sqrt(dot(level, level));
    if (!(size > ABOVE * distance))
        return 0;
    const double b[3] = {level[0] / size, level[1] / size, level[2] / size}, image_up[2] = {-sinking / distance, size / distance};
    const double axes[9] = {b[1] * up[2] - b[2] * up[1], b[0], up[0], b[2] * up[0] - b[0] * up[2], b[1], up[1],
                            b[0] * up[1] - b[1] * up[0], b[2], up[2]};
    static const double nowhere[3] = {0.0, 0.0, 0.0};
    Sight turned;
    ptrdiff_t count = turn_sight(sight, axes, nowhere, &turned);
    if (!count)
        count = assume_along(cloud, axes, floor, image_up, greatest(cell, distance / lens), &turned, found, capacity);
    free((double *)turned.lenses);
    for (ptrdiff_t i = 0; i < count; i++) {
        double *place = found + 3 * i;
        const double local[3] = {place[0], place[1], place[2]};
        for (int row = 0; row < 3; row++)
            place[row] = dot(axes + 3 * row, local);
    }
    return count;
}
