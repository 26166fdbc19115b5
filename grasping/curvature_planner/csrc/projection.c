/* projection.py: the cloud along one approach. */
#include "planner.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MOST_CELLS 100000000
enum { TOGETHER = 256 };

typedef struct {
    double height;
    ptrdiff_t index;
} Entry;

/* The direction across points of the plane. */
static void short_axis(const double *x, const double *y, ptrdiff_t count, double axis[2])
{
    double mean_x = 0.0, mean_y = 0.0, xx = 0.0, xy = 0.0, yy = 0.0, skew = 0.0;
    for (ptrdiff_t i = 0; i < count; i++) {
        mean_x += x[i];
        mean_y += y[i];
    }
    mean_x /= (double)count;
    mean_y /= (double)count;
    for (ptrdiff_t i = 0; i < count; i++) {
        const double dx = x[i] - mean_x, dy = y[i] - mean_y;
        xx += dx * dx;
        xy += dx * dy;
        yy += dy * dy;
    }
    const double angle = 0.5 * atan2(2.0 * xy, xx - yy), across_x = -sin(angle), across_y = cos(angle);
    for (ptrdiff_t i = 0; i < count; i++) {
        const double along = across_x * (x[i] - mean_x) + across_y * (y[i] - mean_y);
        skew += along * along * along;
    }
    axis[0] = skew < 0.0 ? -across_x : across_x;
    axis[1] = skew < 0.0 ? -across_y : across_y;
}

/* Least and greatest coordinate along each axis: of every fourth point each, so that none waits for the one before. */
static void extent(Points cloud, const double axes[9], double low[3], double high[3])
{
    for (int axis = 0; axis < 3; axis++) {
        const double first = project_point(cloud, 0, axes, axis);
        double lows[4] = {first, first, first, first}, highs[4] = {first, first, first, first};
        ptrdiff_t i = 0;
        for (; i + 4 <= cloud.count; i += 4)
            for (int k = 0; k < 4; k++) {
                const double value = project_point(cloud, i + k, axes, axis);
                lows[k] = least(lows[k], value);
                highs[k] = greatest(highs[k], value);
            }
        for (; i < cloud.count; i++) {
            const double value = project_point(cloud, i, axes, axis);
            lows[0] = least(lows[0], value);
            highs[0] = greatest(highs[0], value);
        }
        low[axis] = least(least(lows[0], lows[1]), least(lows[2], lows[3]));
        high[axis] = greatest(greatest(highs[0], highs[1]), greatest(highs[2], highs[3]));
    }
}

/* Number of cells between two coordinates, 0 where it is beyond all reason; and the cell of a coordinate. */
static ptrdiff_t cells_between(double low, double high, double cell)
{
    const double cells = floor((high - low) / cell) + 1.0;
    return cells >= 1.0 && cells <= 1e7 ? (ptrdiff_t)cells : 0;
}

static ptrdiff_t within(double cells, ptrdiff_t count)
{
    return cells > 0.0 ? (ptrdiff_t)least(cells, (double)(count - 1)) : 0;
}

static ptrdiff_t cell_of(double value, double low, double cell, ptrdiff_t count)
{
    return within((value - low) / cell, count);
}

/* Lines and columns of the cells that points lie in, by lines; `places` (2, cloud.count). Returns their number. */
static ptrdiff_t taken_cells(Points cloud, const double axes[9], double cell, double *places)
{
    double low[3], high[3];
    extent(cloud, axes, low, high);
    const ptrdiff_t lines = cells_between(low[0], high[0], cell), columns = cells_between(low[1], high[1], cell);
    if (!lines || !columns || lines > MOST_CELLS / columns)
        return TOO_LARGE;
    char *taken = calloc((size_t)lines * (size_t)columns, 1);
    if (!taken)
        return OUT_OF_MEMORY;
    for (ptrdiff_t i = 0; i < cloud.count; i++)
        taken[cell_of(project_point(cloud, i, axes, 0), low[0], cell, lines) * columns +
              cell_of(project_point(cloud, i, axes, 1), low[1], cell, columns)] = 1;
    ptrdiff_t count = 0;
    for (ptrdiff_t line = 0; line < lines; line++)
        for (ptrdiff_t column = 0; column < columns; column++)
            if (taken[line * columns + column]) {
                places[count] = (double)line;
                places[cloud.count + count++] = (double)column;
            }
    free(taken);
    return count;
}

int short_side(Points cloud, const double axes[9], double cell, double axis[2])
{
    if ((size_t)cloud.count > SIZE_MAX / (2 * sizeof(double)))
        return OUT_OF_MEMORY;
    double *places = malloc(2 * (size_t)cloud.count * sizeof(double));
    if (!places)
        return OUT_OF_MEMORY;
    ptrdiff_t count = cloud.count;
    if (cell > 0.0)
        count = taken_cells(cloud, axes, cell, places);
    else
        for (ptrdiff_t i = 0; i < count; i++) {
            places[i] = project_point(cloud, i, axes, 0);
            places[count + i] = project_point(cloud, i, axes, 1);
        }
    if (count > 0)
        short_axis(places, places + cloud.count, count, axis);
    free(places);
    return count < 0 ? (int)count : 0;
}

ptrdiff_t thin_cloud(Points cloud, const double axes[9], double box, double depth, double *thinned)
{
    double low[3], high[3];
    extent(cloud, axes, low, high);
    const double span = greatest(greatest(high[0] - low[0], high[1] - low[1]), high[2] - low[2]);
    const double size = greatest(box, span / 200.0), sizes[3] = {size, size, depth * size};
    ptrdiff_t counts[3];
    for (int axis = 0; axis < 3; axis++)
        counts[axis] = cells_between(low[axis], high[axis], sizes[axis]);
    if (!counts[0] || !counts[1] || !counts[2] || counts[0] * counts[1] > MOST_CELLS / counts[2])
        return TOO_LARGE; /* never: no axis has more than 201 boxes, unless a coordinate is not finite */
    const size_t boxes = (size_t)(counts[0] * counts[1] * counts[2]);
    Entry *highest = malloc(boxes * sizeof(Entry));
    if (!highest)
        return OUT_OF_MEMORY;
    for (size_t i = 0; i < boxes; i++)
        highest[i] = (Entry){-INFINITY, -1};
    for (ptrdiff_t start = 0; start < cloud.count; start += TOGETHER) { /* divided together, which is faster */
        double cells[3][TOGETHER], heights[TOGETHER];
        const ptrdiff_t some = cloud.count - start < TOGETHER ? cloud.count - start : TOGETHER;
        for (int axis = 0; axis < 3; axis++)
            for (ptrdiff_t k = 0; k < some; k++) {
                heights[k] = project_point(cloud, start + k, axes, axis);
                cells[axis][k] = (heights[k] - low[axis]) / sizes[axis];
            }
        for (ptrdiff_t k = 0; k < some; k++) {
            ptrdiff_t key = 0;
            for (int axis = 0; axis < 3; axis++)
                key = key * counts[axis] + within(cells[axis][k], counts[axis]);
            if (heights[k] >= highest[key].height)
                highest[key] = (Entry){heights[k], start + k};
        }
    }
    ptrdiff_t count = 0;
    for (size_t i = 0; i < boxes; i++)
        if (highest[i].index >= 0) {
            thinned[count] = cloud.x[highest[i].index];
            thinned[cloud.count + count] = cloud.y[highest[i].index];
            thinned[2 * cloud.count + count++] = cloud.height[highest[i].index];
        }
    free(highest);
    return count;
}

/* Estimate of the centre of mass of points in rising height: each cell counts once, by the height of what stands there.
 * footprint: the centre, how far from it the farthest cell is, and the volume of what stands in all of them. */
static int centre_of(Points local, double cell, double footprint[4])
{
    static const double identity[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
    double low[3], high[3], sum = 0.0, first = 0.0, second = 0.0;
    extent(local, identity, low, high);
    const ptrdiff_t lines = cells_between(low[0], high[0], cell), columns = cells_between(low[1], high[1], cell);
    if (!lines || !columns || lines > MOST_CELLS / columns)
        return TOO_LARGE;
    double *highest = calloc((size_t)lines * (size_t)columns, sizeof(double));
    if (!highest)
        return OUT_OF_MEMORY;
    for (ptrdiff_t i = 0; i < local.count; i++) /* the last one written, the highest, stays */
        highest[cell_of(local.x[i], low[0], cell, lines) * columns + cell_of(local.y[i], low[1], cell, columns)] =
            greatest(local.height[i], 0.003);
    for (ptrdiff_t line = 0; line < lines; line++)
        for (ptrdiff_t column = 0; column < columns; column++) {
            const double weight = highest[line * columns + column];
            sum += weight;
            first += weight * (double)line;
            second += weight * (double)column;
        }
    double farthest = 0.0;
    first /= sum;
    second /= sum;
    for (ptrdiff_t line = 0; line < lines; line++)
        for (ptrdiff_t column = 0; column < columns; column++)
            if (highest[line * columns + column] > 0.0) {
                const double away = (double)line - first, aside = (double)column - second;
                farthest = greatest(farthest, away * away + aside * aside);
            }
    free(highest);
    footprint[0] = low[0] + cell * (first + 0.5);
    footprint[1] = low[1] + cell * (second + 0.5);
    footprint[2] = cell * sqrt(farthest);
    footprint[3] = sum * (cell * cell);
    return 0;
}

int place_cloud(
    Points cloud, const double axes[9], double table_height, double cell, double *local, double middle[3],
    double footprint[4])
{
    const ptrdiff_t count = cloud.count;
    if ((size_t)count > SIZE_MAX / (4 * sizeof(double)))
        return OUT_OF_MEMORY;
    double *heights = calloc((size_t)count, sizeof(double));
    int64_t *order = malloc(2 * (size_t)count * sizeof(int64_t));
    uint64_t *bits = malloc((size_t)count * sizeof(uint64_t));
    const int failed = !heights || !order || !bits;
    if (!failed) {
        double low[3], high[3];
        extent(cloud, axes, low, high);
        for (int axis = 0; axis < 3; axis++)
            middle[axis] = 0.5 * (low[axis] + high[axis]);
        const int on_table = table_height == table_height;
        middle[2] = on_table ? table_height : low[2];
        for (ptrdiff_t i = 0; i < count; i++) {
            heights[i] = project_point(cloud, i, axes, 2);
            order[i] = i;
        }
        sort_indices(heights, count, order, order + count, bits);
        for (ptrdiff_t i = 0; i < count; i++) {
            const ptrdiff_t from = (ptrdiff_t)order[i];
            const double height = heights[from] - middle[2];
            local[i] = project_point(cloud, from, axes, 0) - middle[0];
            local[count + i] = project_point(cloud, from, axes, 1) - middle[1];
            local[2 * count + i] = on_table ? greatest(height, 0.0) : height; /* under the table is noise of the table */
        }
    }
    free(heights);
    free(order);
    free(bits);
    return failed ? OUT_OF_MEMORY
                  : centre_of((Points){local, local + count, local + 2 * count, count}, cell, footprint);
}

ptrdiff_t neighbours_of(
    Rows others, const double axes[9], const double middle[3], const double reach[2], double cell, double *local)
{
    const ptrdiff_t all = others.count;
    double *x = local, *y = local + all, *height = y + all;
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    ptrdiff_t count = 0;
    for (ptrdiff_t i = 0; i < all; i++) {
        const double *at = others.at + 3 * i;
        const Points point = {at, at + 1, at + 2, 1};
        x[count] = project_point(point, 0, axes, 0) - middle[0];
        y[count] = project_point(point, 0, axes, 1) - middle[1];
        if (!(fabs(x[count]) <= reach[0] && fabs(y[count]) <= reach[1]))
            continue;
        height[count] = project_point(point, 0, axes, 2) - middle[2];
        low[0] = least(low[0], x[count]);
        high[0] = greatest(high[0], x[count]);
        low[1] = least(low[1], y[count]);
        high[1] = greatest(high[1], y[count]);
        count++;
    }
    if (!count)
        return 0;
    const ptrdiff_t lines = cells_between(low[0], high[0], cell), columns = cells_between(low[1], high[1], cell);
    if (!lines || !columns || lines > MOST_CELLS / columns)
        return TOO_LARGE;
    const size_t cells = (size_t)lines * (size_t)columns, number = (size_t)count;
    ptrdiff_t *top = malloc(cells * sizeof(ptrdiff_t));
    double *kept = malloc(number * sizeof(double));
    int64_t *order = malloc(2 * number * sizeof(int64_t));
    uint64_t *bits = malloc(number * sizeof(uint64_t));
    const int failed = !top || !kept || !order || !bits;
    ptrdiff_t taken = 0;
    if (!failed) {
        memset(top, -1, cells * sizeof(ptrdiff_t));
        for (ptrdiff_t i = 0; i < count; i++) { /* of equally high ones the last one */
            ptrdiff_t *of = &top[cell_of(x[i], low[0], cell, lines) * columns + cell_of(y[i], low[1], cell, columns)];
            if (*of < 0 || height[i] >= height[*of])
                *of = i;
        }
        for (ptrdiff_t i = 0; i < count; i++)
            if (top[cell_of(x[i], low[0], cell, lines) * columns + cell_of(y[i], low[1], cell, columns)] == i) {
                x[taken] = x[i];
                y[taken] = y[i];
                height[taken] = height[i];
                order[taken] = taken;
                taken++;
            }
        sort_indices(height, taken, order, order + count, bits);
        for (int row = 0; row < 3; row++) {
            memcpy(kept, local + row * all, (size_t)taken * sizeof(double));
            for (ptrdiff_t i = 0; i < taken; i++)
                local[row * all + i] = kept[order[i]];
        }
    }
    free(top);
    free(kept);
    free(order);
    free(bits);
    return failed ? OUT_OF_MEMORY : taken;
}
