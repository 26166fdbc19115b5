/* Repeats voting.vote. */
#include "pose.h"

#include <stdlib.h>
#include <string.h>

/* The cells of numbers in bins, with the neighbours of what is near a border, or 0 where they are none; see
   point_pairs.spread_cells. */
static int spread(const double bins[4], int32_t cells[16])
{
    const int32_t limits[4] = {DISTANCES, ANGLES, ANGLES, ANGLES};
    int32_t step[4], whole[4];
    for (int axis = 0; axis < 4; axis++) {
        if (!(bins[axis] >= 0.0 && bins[axis] < 1e9))
            return 0;
        const int32_t number = (int32_t)bins[axis];
        whole[axis] = number < limits[axis] ? number : limits[axis] - 1;
        const double part = bins[axis] - whole[axis];
        step[axis] = (part > 1.0 - SPREAD) - (part < SPREAD);
        if (whole[axis] + step[axis] < 0 || whole[axis] + step[axis] >= limits[axis])
            step[axis] = 0;
    }
    int count = 1, stride = 1;
    cells[0] = 0;
    for (int axis = 3; axis >= 0; axis--, stride *= ANGLES) {
        for (int k = 0; k < count; k++)
            cells[k] += whole[axis] * stride;
        if (step[axis]) {
            for (int k = 0; k < count; k++)
                cells[count + k] = cells[k] + step[axis] * stride;
            count *= 2;
        }
    }
    return count;
}

int count_votes(const Table *table, const int32_t *row, const double *bins, const int32_t *turn, ptrdiff_t count,
                ptrdiff_t rows, ptrdiff_t peaks, int32_t *found)
{
    const int32_t turns = table->turns, parts = turns * table->fine;
    const ptrdiff_t size = table->points * turns;
    for (ptrdiff_t i = 0; i < CELLS; i++)
        if (table->starts[i] < 0 || table->starts[i] > table->starts[i + 1] || table->starts[i + 1] > table->entries)
            return OUT_OF_RANGE;
    for (ptrdiff_t i = 0; i < table->entries; i++)
        if (table->first[i] < 0 || table->first[i] >= table->points || table->turn[i] < 0 || table->turn[i] >= parts)
            return OUT_OF_RANGE;
    for (ptrdiff_t i = 0; i < count; i++)
        if (row[i] < (i ? row[i - 1] : 0) || row[i] >= rows || turn[i] < 0 || turn[i] >= parts)
            return OUT_OF_RANGE;
    int32_t *votes = malloc((size_t)size * sizeof(*votes) + 1);
    int32_t *bin = malloc((size_t)(2 * parts) * sizeof(*bin) + 1); /* of a difference + parts */
    if (!votes || !bin) {
        free(votes);
        free(bin);
        return OUT_OF_MEMORY;
    }
    for (int32_t i = 0; i < 2 * parts; i++)
        bin[i] = i % parts / table->fine;
    ptrdiff_t next = 0;
    for (ptrdiff_t number = 0; number < rows; number++) {
        memset(votes, 0, (size_t)size * sizeof(*votes));
        for (; next < count && row[next] == number; next++) {
            const int32_t *turned = bin + turn[next] + parts;
            int32_t cells[16];
            const int near = spread(bins + 4 * next, cells);
            for (int c = 0; c < near; c++)
                for (int32_t k = table->starts[cells[c]]; k < table->starts[cells[c] + 1]; k++)
                    votes[table->first[k] * turns + turned[-table->turn[k]]]++;
        }
        int32_t *best = found + number * peaks * 3; /* sorted, the highest first */
        ptrdiff_t filled = 0;
        for (ptrdiff_t point = 0; point < table->points; point++) {
            const int32_t *own = votes + point * turns;
            int32_t most = -1, where = 0;
            for (int32_t k = 0; k < turns; k++) {
                const int32_t sum = 2 * own[k] + own[k ? k - 1 : turns - 1] + own[k + 1 < turns ? k + 1 : 0];
                if (sum > most) {
                    most = sum;
                    where = k;
                }
            }
            ptrdiff_t place = filled;
            while (place > 0 && best[3 * (place - 1)] < most)
                place--;
            if (place >= peaks)
                continue;
            const ptrdiff_t last = filled < peaks ? filled : peaks - 1;
            memmove(best + 3 * (place + 1), best + 3 * place, (size_t)(3 * (last - place)) * sizeof(*best));
            best[3 * place] = most;
            best[3 * place + 1] = (int32_t)point;
            best[3 * place + 2] = where * table->fine + table->fine / 2;
            filled += filled < peaks;
        }
    }
    free(votes);
    free(bin);
    return 0;
}
