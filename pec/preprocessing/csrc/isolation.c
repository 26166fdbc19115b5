/* How far a point's fourth nearest neighbour is away: see pec.preprocessing.isolated, its reference. */
#include "preprocessing.h"

#define NEIGHBOURS 4
#define MOST_CELLS 64 /* along an axis */

/* The points sorted into the cells of a grid of cubes: those of cell c are order[first[c]] to order[first[c + 1] - 1]. */
typedef struct {
    const double *points;
    double lowest[3], edge;
    ptrdiff_t cells; /* along each axis */
    ptrdiff_t *first, *order;
} Grid;

static ptrdiff_t along(const Grid *grid, ptrdiff_t i, int axis)
{
    const ptrdiff_t cell = (ptrdiff_t)((grid->points[3 * i + axis] - grid->lowest[axis]) / grid->edge);
    return cell < grid->cells ? cell : grid->cells - 1;
}

static ptrdiff_t cell_of(const Grid *grid, ptrdiff_t i)
{
    return (along(grid, i, 0) * grid->cells + along(grid, i, 1)) * grid->cells + along(grid, i, 2);
}

/* About as many cells are on a surface as there are points. Returns 0 where memory is short; to be freed: first. */
static int sort_into_cells(Grid *grid, ptrdiff_t n)
{
    double longest = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        double low = INFINITY, high = -INFINITY;
        for (ptrdiff_t i = 0; i < n; i++) {
            const double x = grid->points[3 * i + axis];
            low = x < low ? x : low;
            high = x > high ? x : high;
        }
        grid->lowest[axis] = low;
        longest = high - low > longest ? high - low : longest;
    }
    const ptrdiff_t cells = (ptrdiff_t)(0.5 * sqrt((double)n));
    grid->cells = longest == 0.0 || cells < 1 ? 1 : cells > MOST_CELLS ? MOST_CELLS : cells;
    grid->edge = longest == 0.0 ? 1.0 : longest / (double)grid->cells;
    const ptrdiff_t total = grid->cells * grid->cells * grid->cells;
    grid->first = calloc((size_t)(total + 1 + n), sizeof *grid->first);
    if (!grid->first)
        return 0;
    grid->order = grid->first + total + 1;
    for (ptrdiff_t i = 0; i < n; i++)
        grid->first[cell_of(grid, i) + 1]++;
    for (ptrdiff_t c = 0; c < total; c++)
        grid->first[c + 1] += grid->first[c];
    for (ptrdiff_t i = n; i-- > 0;) /* each cell is filled from its end, which so becomes its beginning … */
        grid->order[--grid->first[cell_of(grid, i) + 1]] = i;
    for (ptrdiff_t c = 0; c < total; c++) /* … of the one before */
        grid->first[c] = grid->first[c + 1];
    grid->first[total] = n;
    return 1;
}

/* Takes the points of a cell into the squared distances `away`, the least first. */
static void take_cell(const Grid *grid, ptrdiff_t cell, ptrdiff_t from, double away[NEIGHBOURS])
{
    const double *const at = grid->points + 3 * from;
    for (ptrdiff_t k = grid->first[cell]; k < grid->first[cell + 1]; k++) {
        const double *const p = grid->points + 3 * grid->order[k];
        const double x = p[0] - at[0], y = p[1] - at[1], z = p[2] - at[2], squared = x * x + y * y + z * z;
        if (squared >= away[NEIGHBOURS - 1] || grid->order[k] == from)
            continue;
        int place = NEIGHBOURS - 1;
        for (; place && away[place - 1] > squared; place--)
            away[place] = away[place - 1];
        away[place] = squared;
    }
}

/* Squared distance of the fourth nearest neighbour, shell after shell of cells about that of the point. */
static double fourth(const Grid *grid, ptrdiff_t i)
{
    const ptrdiff_t cells = grid->cells;
    const ptrdiff_t here[3] = {along(grid, i, 0), along(grid, i, 1), along(grid, i, 2)};
    double away[NEIGHBOURS] = {INFINITY, INFINITY, INFINITY, INFINITY};
    for (ptrdiff_t shell = 0; shell < cells; shell++) {
        for (ptrdiff_t a = here[0] - shell; a <= here[0] + shell; a++) {
            if (a < 0 || a >= cells)
                continue;
            for (ptrdiff_t b = here[1] - shell; b <= here[1] + shell; b++) {
                if (b < 0 || b >= cells)
                    continue;
                const int inside = a != here[0] - shell && a != here[0] + shell && b != here[1] - shell &&
                                   b != here[1] + shell;
                const ptrdiff_t step = inside ? 2 * shell : 1; /* of a row through the shell its two ends */
                for (ptrdiff_t c = here[2] - shell; c <= here[2] + shell; c += step)
                    if (c >= 0 && c < cells)
                        take_cell(grid, (a * cells + b) * cells + c, i, away);
            }
        }
        const double seen = grid->edge * (double)shell; /* nothing that is nearer was left out */
        if (away[NEIGHBOURS - 1] <= seen * seen)
            break;
    }
    return away[NEIGHBOURS - 1];
}

int isolations(const double *points, ptrdiff_t n, double *out)
{
    Grid grid = {.points = points};
    if (!sort_into_cells(&grid, n))
        return 0;
    for (ptrdiff_t i = 0; i < n; i++)
        out[i] = sqrt(fourth(&grid, i));
    free(grid.first);
    return 1;
}
