/* Repeats voting.vote. */
#include "pose.h"

#include <stdlib.h>
#include <string.h>

int count_votes(const Table *table, const int32_t *row, const int32_t *cell, const int32_t *turn, ptrdiff_t count,
                ptrdiff_t rows, ptrdiff_t peaks, int32_t *found)
{
    const int32_t turns = table->turns, parts = turns * table->fine;
    const ptrdiff_t size = table->points * turns;
    for (ptrdiff_t i = 0; i < table->cells; i++)
        if (table->starts[i] < 0 || table->starts[i] > table->starts[i + 1] || table->starts[i + 1] > table->entries)
            return OUT_OF_RANGE;
    for (ptrdiff_t i = 0; i < table->entries; i++)
        if (table->first[i] < 0 || table->first[i] >= table->points || table->turn[i] < 0 || table->turn[i] >= parts)
            return OUT_OF_RANGE;
    for (ptrdiff_t i = 0; i < count; i++)
        if (row[i] < (i ? row[i - 1] : 0) || row[i] >= rows || cell[i] < 0 || cell[i] >= table->cells || turn[i] < 0 ||
            turn[i] >= parts)
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
            for (int32_t k = table->starts[cell[next]]; k < table->starts[cell[next] + 1]; k++)
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
