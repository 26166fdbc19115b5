/* Repeats scene_surface.normals_at. */
#include "pose.h"
#include "selection.h"
#include "symmetric.h"

#include <stdlib.h>
#include <string.h>

#define SLACK 1.000001 /* for what rounding does to a sum of distances */

SELECTION(select_double, double)

/* The points, which lie in the order of one coordinate, and room for numbers of all of them. */
typedef struct {
    const double *points;
    ptrdiff_t count, axis, *number;
    double *squared, *sorted;
} Search;

static ptrdiff_t first_at(const Search *search, double least)
{
    ptrdiff_t low = 0, high = search->count;
    while (low < high) {
        const ptrdiff_t middle = low + (high - low) / 2;
        if (search->points[3 * middle + search->axis] < least)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Leave the numbers of the `wanted` points nearest to a place, in their order, in search->number: at least as many are
 * known to lie within `reach`. Returns how far off the last of them is, squared; −1 where there are fewer after all,
 * as of points in no order. */
static double find_nearest(const Search *search, const double *place, double reach, ptrdiff_t wanted)
{
    const double most = reach * reach, end = place[search->axis] + reach;
    ptrdiff_t found = 0, kept = 0, below = 0;
    for (ptrdiff_t i = first_at(search, place[search->axis] - reach); i < search->count; i++) {
        const double *point = search->points + 3 * i;
        if (point[search->axis] > end)
            break;
        const double dx = point[0] - place[0], dy = point[1] - place[1], dz = point[2] - place[2];
        const double squared = dx * dx + dy * dy + dz * dz;
        search->squared[found] = squared;
        search->number[found] = i;
        found += squared <= most;
    }
    if (found < wanted)
        return -1.0;
    memcpy(search->sorted, search->squared, (size_t)found * sizeof(double));
    const double last = select_double(search->sorted, 0, found - 1, wanted - 1);
    for (ptrdiff_t i = 0; i < found; i++)
        below += search->squared[i] < last;
    /* Of those that are as far off as the last the first come in. */
    ptrdiff_t alike = wanted - below;
    for (ptrdiff_t i = 0; i < found; i++) {
        const int equal = search->squared[i] == last;
        if (search->squared[i] < last || (equal && alike > 0)) {
            search->number[kept++] = search->number[i];
            alike -= equal;
        }
    }
    return last;
}

static void fit_normal(const double *points, const ptrdiff_t *number, ptrdiff_t count, double normal[3])
{
    double mean[3] = {0.0, 0.0, 0.0}, half[6] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0}, values[3], axes[3][3];
    for (ptrdiff_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++)
            mean[c] += points[3 * number[i] + c];
    for (int c = 0; c < 3; c++)
        mean[c] /= (double)count;
    for (ptrdiff_t i = 0; i < count; i++) {
        const double *point = points + 3 * number[i];
        const double x = point[0] - mean[0], y = point[1] - mean[1], z = point[2] - mean[2];
        half[0] += x * x;
        half[1] += x * y;
        half[2] += x * z;
        half[3] += y * y;
        half[4] += y * z;
        half[5] += z * z;
    }
    for (int i = 0; i < 6; i++)
        half[i] /= (double)count;
    find_axes(half, values, axes);
    int least = values[1] < values[0] ? 1 : 0;
    least = values[2] < values[least] ? 2 : least;
    for (int c = 0; c < 3; c++)
        normal[c] = axes[c][least];
}

int fit_normals(const double *points, ptrdiff_t count, const double *places, ptrdiff_t asked, ptrdiff_t axis,
                ptrdiff_t neighbours, double *normals)
{
    double *squared = malloc((size_t)count * (2 * sizeof(double) + sizeof(ptrdiff_t)));
    if (!squared)
        return OUT_OF_MEMORY;
    const Search search = {points, count, axis, (ptrdiff_t *)(squared + 2 * count), squared, squared + count};
    double reach = INFINITY;
    int code = 0;
    for (ptrdiff_t i = 0; i < asked; i++) {
        const double *place = places + 3 * i;
        const double last = find_nearest(&search, place, reach, neighbours);
        if (last < 0.0) {
            code = OUT_OF_RANGE;
            break;
        }
        fit_normal(points, search.number, neighbours, normals + 3 * i);
        if (i + 1 < asked) { /* what is nearest to this place is no farther from the next than both together */
            const double dx = place[3] - place[0], dy = place[4] - place[1], dz = place[5] - place[2];
            reach = (sqrt(last) + sqrt(dx * dx + dy * dy + dz * dz)) * SLACK;
        }
    }
    free(squared);
    return code;
}
