/* finger_scan.scan: where two fingers that come straight in can stand beside an object. */
#include "planner.h"

#include <math.h>
#include <stdlib.h>

static const double X_STEP = 0.003;
static const double MOST_GAIN = 0.031; /* m of a run's cost, and somewhat more, that overlap and room may save */
enum { ROWS = 3 };

/* A map of heights turned by one heading, with one more column and line on either side for what lies outside. */
typedef struct {
    float *cells;
    ptrdiff_t lines, columns; /* without the margins */
} Map;

/* What a run is ordered by: its cost, and its place in the order in which the reference lists them. */
typedef struct {
    double cost;
    ptrdiff_t several, tip, line, start;
} Rank;

/* Bins start … end of a line, between two places where a finger stands free. */
typedef struct {
    Rank rank;
    double terms[HOLD_TERMS], slopes[2]; /* of the two contours, of which the angle is made in the end */
} Run;

typedef struct {
    Run runs[MEASURED];
    Run *heap[MEASURED]; /* the worst on top */
    ptrdiff_t count;
} Best;

static float highest(float a, float b) { return b > a ? b : a; }

/* first, last: of the columns that the points take. */
static void draw(Map map, Points points, double cosine, double sine, double row, ptrdiff_t *first, ptrdiff_t *last)
{
    const ptrdiff_t stride = map.columns + 2;
    for (ptrdiff_t i = 0; i < (map.lines + 2) * stride; i++)
        map.cells[i] = -INFINITY;
    const double per_column = 1.0 / X_STEP, per_line = 1.0 / row;
    const double middle_column = 0.5 * (double)map.columns + 1.0, middle_line = 0.5 * (double)map.lines + 1.0;
    const double last_column = (double)(map.columns + 1), last_line = (double)(map.lines + 1);
    double least_column = last_column, most_column = 0.0;
    for (ptrdiff_t i = 0; i < points.count; i++) {
        double column = (cosine * points.x[i] + sine * points.y[i]) * per_column + middle_column;
        double line = (cosine * points.y[i] - sine * points.x[i]) * per_line + middle_line;
        column = column > 0.0 ? least(column, last_column) : 0.0; /* NaN is outside as well */
        line = line > 0.0 ? least(line, last_line) : 0.0;
        least_column = least(least_column, column);
        most_column = column > most_column ? column : most_column;
        float *cell = map.cells + (ptrdiff_t)line * stride + (ptrdiff_t)column;
        *cell = highest(*cell, (float)points.height[i]);
    }
    *first = (ptrdiff_t)least_column > 1 ? (ptrdiff_t)least_column - 1 : 0;
    *last = (ptrdiff_t)most_column - 1 < map.columns ? (ptrdiff_t)most_column - 1 : map.columns - 1;
}

/* Greatest height under a pad that covers this line, the next and the one after; from one column to another. */
static void band(Map map, ptrdiff_t line, ptrdiff_t from, ptrdiff_t to, float *out)
{
    const float *first = map.cells + (line + 1) * (map.columns + 2) + 1;
    const float *second = first + map.columns + 2, *third = second + map.columns + 2;
    for (ptrdiff_t i = from; i <= to; i++)
        out[i] = highest(highest(first[i], second[i]), third[i]);
}

static int listed_later(const Rank *a, const Rank *b)
{
    if (a->several != b->several)
        return a->several > b->several;
    if (a->tip != b->tip)
        return a->tip > b->tip;
    if (a->line != b->line)
        return a->line > b->line;
    return a->start > b->start;
}

static int worse(const Rank *a, const Rank *b)
{
    return a->cost > b->cost || (a->cost == b->cost && listed_later(a, b));
}

static int by_list(const void *a, const void *b)
{
    const Rank *one = &(*(Run *const *)a)->rank, *other = &(*(Run *const *)b)->rank;
    return listed_later(one, other) - listed_later(other, one);
}

/* Whether a run of this rank is among the best so far. */
static int welcome(const Best *best, const Rank *rank)
{
    return best->count < MEASURED || worse(&best->heap[0]->rank, rank);
}

/* The place of a run that is welcome, in that of the worst one where all are taken. */
static Run *place_for(Best *best, const Rank *rank)
{
    ptrdiff_t at = 0;
    Run *own = best->heap[0];
    if (best->count == MEASURED) {
        for (ptrdiff_t child; (child = 2 * at + 1) < best->count; at = child) {
            if (child + 1 < best->count && worse(&best->heap[child + 1]->rank, &best->heap[child]->rank))
                child++;
            if (!worse(&best->heap[child]->rank, rank))
                break;
            best->heap[at] = best->heap[child];
        }
    } else {
        own = &best->runs[best->count];
        for (at = best->count++; at > 0 && worse(rank, &best->heap[(at - 1) / 2]->rank); at = (at - 1) / 2)
            best->heap[at] = best->heap[(at - 1) / 2];
    }
    best->heap[at] = own;
    own->rank = *rank;
    return own;
}

/* Slope of the contour over the outer rows under the pad; over the half that is there where one is missing. */
static double slope(const ptrdiff_t position[ROWS], const int present[ROWS], double row)
{
    const double x0 = (double)position[0] * X_STEP, x1 = (double)position[1] * X_STEP;
    const double x2 = (double)position[2] * X_STEP;
    if (present[0] && present[2])
        return (x2 - x0) / (2 * row);
    if (present[1] && present[2])
        return (x2 - x1) / row;
    return present[0] && present[1] ? (x1 - x0) / row : 0.0;
}

/* Slopes of the two contours of a run. */
static void contours(Map map, ptrdiff_t line, ptrdiff_t start, ptrdiff_t end, float level, double row, double slopes[2])
{
    ptrdiff_t first[ROWS], last[ROWS];
    int present[ROWS];
    for (int i = 0; i < ROWS; i++) {
        const float *cells = map.cells + (line + 1 + i) * (map.columns + 2) + 1;
        ptrdiff_t a = start, b = end;
        while (a <= end && !(cells[a] > level))
            a++;
        while (b > a && !(cells[b] > level))
            b--;
        present[i] = a <= end;
        first[i] = a;
        last[i] = b;
    }
    slopes[0] = slope(first, present, row);
    slopes[1] = slope(last, present, row);
}

/* The angle between two contours and the pads, the worse side after the best turn. */
static double worse_angle(const double slopes[2])
{
    const double turn = atan(0.5 * (slopes[0] + slopes[1]));
    const double one = fabs(atan(slopes[0]) - turn), other = fabs(atan(slopes[1]) - turn);
    return other > one ? other : one;
}

/* Everything that a line of the map is looked at with. */
typedef struct {
    Map map;
    const ScanSettings *settings;
    double row;
    ptrdiff_t heading, line, first, last; /* line: within the map; first and last column that the object takes */
    float *bands, *walls, *beside;       /* walls and beside: from `wished` bins before the first one on */
    const float *before, *after;         /* greatest height in the bins that a finger takes beside each one */
    ptrdiff_t *rise, *fall, *ends;       /* bins at which a run may start or end at some height, and at one height */
    ptrdiff_t rises, falls;
    Best *best;
    ScanResult *result;
} Line;

/* Whether something hangs over these bins of the object so low that the palm would come down on it. */
static int is_under(const Line *at, ptrdiff_t start, ptrdiff_t end, float palm)
{
    const float *walls = at->walls + at->settings->wished;
    for (ptrdiff_t i = start; i <= end; i++)
        if (walls[i] > palm && walls[i] > at->bands[i])
            return 1;
    return 0;
}

static void add_run(const Line *at, ptrdiff_t tip, ptrdiff_t start, ptrdiff_t end, int several, int whole)
{
    const ScanSettings *settings = at->settings;
    const double width = (double)(end - start + 1) * X_STEP, height = settings->tips[tip];
    if (!(width <= settings->greatest_width)) {
        at->result->too_wide += 1.0;
        at->result->narrowest = least(at->result->narrowest, width);
        return;
    }
    const ptrdiff_t lines = at->map.lines - 2;
    const double along = (0.5 * (double)(start + end + 1 - at->map.columns)) * X_STEP;
    const double across = ((double)at->line + 0.5 - 0.5 * (double)lines) * at->row;
    const double cosine = settings->cosines[at->heading], sine = settings->sines[at->heading];
    const double x = cosine * along - sine * across, y = sine * along + cosine * across;
    const double dx = x - settings->centre_x, dy = y - settings->centre_y;
    double cost = sqrt(dx * dx + dy * dy) + (0.3 * (double)(end - start)) * X_STEP;
    if (at->best->count == MEASURED && cost - MOST_GAIN > at->best->heap[0]->rank.cost)
        return;
    const float level = (float)height, *bands = at->bands, *wall = at->walls + settings->wished;
    ptrdiff_t free_bins = 0;
    for (ptrdiff_t bins = settings->finger + 1; bins <= settings->wished; bins++, free_bins++)
        if (!(highest(wall[start - bins], wall[end + bins]) <= level))
            break;
    const ptrdiff_t spare = settings->wished - settings->finger;
    const double room = (double)free_bins / (double)(spare > 1 ? spare : 1);
    const float first = highest(bands[start], bands[start + 1 < end ? start + 1 : end]);
    const float last = highest(bands[end], bands[end - 1 > start ? end - 1 : start]);
    const double overlap = (double)(last < first ? last : first) - height;
    cost -= (0.02 * least(overlap, 0.03)) / 0.03 + 0.01 * room;
    const Rank rank = {cost, several, tip, at->heading * lines + at->line, start};
    if (!welcome(at->best, &rank) || is_under(at, start, end, (float)(height + settings->reach)))
        return;
    Run *run = place_for(at->best, &rank);
    run->terms[HOLD_HEADING] = settings->headings[at->heading];
    run->terms[HOLD_X] = x;
    run->terms[HOLD_Y] = y;
    run->terms[HOLD_TIP] = height;
    run->terms[HOLD_WIDTH] = width;
    run->terms[HOLD_OVERLAP] = overlap;
    contours(at->map, at->line, start, end, level, at->row, run->slopes);
    run->terms[HOLD_ROOM] = room;
    run->terms[HOLD_WHOLE] = whole;
}

/* Pair free places with free places: with the next one (a part of the object) and with the last one (all of it). */
static void pair(const Line *at, ptrdiff_t tip, ptrdiff_t from, ptrdiff_t to)
{
    const float level = (float)at->settings->tips[tip];
    while (from <= to && !(at->bands[from] > level))
        from++;
    while (to > from && !(at->bands[to] > level))
        to--;
    ptrdiff_t count = 0;
    for (ptrdiff_t i = 0; i < at->falls; i++) { /* written always and kept sometimes: a branch would be guessed wrong */
        const ptrdiff_t bin = at->fall[i];
        at->ends[count] = bin;
        count += (at->bands[bin] > level) & (at->after[bin] <= level);
    }
    for (ptrdiff_t i = 0, next = 0; i < at->rises && next < count; i++) {
        const ptrdiff_t bin = at->rise[i];
        if (!((at->bands[bin] > level) & (at->before[bin] <= level)))
            continue;
        while (next < count && at->ends[next] < bin)
            next++;
        if (next == count)
            break;
        const ptrdiff_t end = at->ends[next], last = at->ends[count - 1];
        add_run(at, tip, bin, end, 0, bin <= from && end >= to);
        if (last > end)
            add_run(at, tip, bin, last, 1, bin <= from && last >= to);
    }
}

/* Greatest of the `size` values from each one on, in place; the last size − 1 are left in between. */
static void highest_in_window(float *values, ptrdiff_t count, ptrdiff_t size)
{
    for (ptrdiff_t window = 1, step; window < size; window += step) {
        step = window < size - window ? window : size - window;
        for (ptrdiff_t i = 0; i + step < count; i++)
            values[i] = highest(values[i], values[i + step]);
    }
}

static void scan_line(Line *at, Map others, float lowest)
{
    const ptrdiff_t wished = at->settings->wished;
    float *bands = at->bands, *walls = at->walls, *beside = at->beside;
    ptrdiff_t from = at->first, to = at->last;
    band(at->map, at->line, from, to, bands);
    while (from <= to && !(bands[from] > lowest))
        from++;
    while (to > from && !(bands[to] > lowest))
        to--;
    if (from > to)
        return;
    for (ptrdiff_t i = from; i <= to + 2 * wished; i++)
        walls[i] = -INFINITY;
    if (others.cells)
        band(others, at->line, from > wished ? from - wished : 0,
             to + wished < others.columns ? to + wished : others.columns - 1, walls + wished);
    for (ptrdiff_t i = at->first > from - wished ? at->first : from - wished; i <= at->last && i <= to + wished; i++)
        walls[wished + i] = highest(walls[wished + i], bands[i]);
    for (ptrdiff_t i = from; i <= to + 2 * wished; i++)
        beside[i] = walls[i];
    highest_in_window(beside + from, to + 2 * wished - from + 1, at->settings->finger);
    at->rises = at->falls = 0;
    for (ptrdiff_t i = from; i <= to; i++) {
        at->rise[at->rises] = at->fall[at->falls] = i;
        at->rises += bands[i] > at->before[i];
        at->falls += bands[i] > at->after[i];
    }
    for (ptrdiff_t tip = 0; tip < at->settings->tip_count; tip++)
        pair(at, tip, from, to);
}

int scan_holds(Points object, Points others, const ScanSettings *settings, double *holds, ScanResult *result)
{
    double square = 0.0;
    for (ptrdiff_t i = 0; i < object.count; i++) {
        const double each = object.x[i] * object.x[i] + object.y[i] * object.y[i];
        square = each > square ? each : square;
    }
    const double row = settings->pad_width / ROWS, radius = sqrt(square);
    const double half_lines = ceil(radius / row), half_columns = ceil((radius + settings->wished_room) / X_STEP);
    if (!(half_lines < 1e6 && half_columns < 1e6 && half_lines * half_columns < 1e8))
        return TOO_LARGE;
    const ptrdiff_t ny = 2 * (ptrdiff_t)half_lines + 3, nx = 2 * (ptrdiff_t)half_columns + 3;
    const size_t cells = (size_t)(ny + 2) * (size_t)(nx + 2);
    const size_t padded = (size_t)nx + 2 * (size_t)settings->wished;
    float *memory = malloc((2 * cells + (size_t)nx + 2 * padded) * sizeof(float));
    ptrdiff_t *bins = malloc(3 * (size_t)nx * sizeof(ptrdiff_t));
    Best *best = malloc(sizeof(Best));
    result->count = 0;
    result->too_wide = 0.0;
    result->narrowest = INFINITY;
    if (memory && bins && best) {
        const Map map = {memory, ny, nx}, around = {others.count ? memory + cells : NULL, ny, nx};
        float *bands = memory + 2 * cells, *walls = bands + nx, *beside = walls + padded;
        float lowest = INFINITY;
        for (ptrdiff_t tip = 0; tip < settings->tip_count; tip++)
            lowest = (float)settings->tips[tip] < lowest ? (float)settings->tips[tip] : lowest;
        best->count = 0;
        const float *before = beside + settings->wished - settings->finger, *after = beside + settings->wished + 1;
        Line at = {map, settings, row,    0,     0,    0,         0,             bands, walls,
                   beside, before, after, bins, bins + nx, bins + 2 * nx, 0,     0,     best, result};
        for (; at.heading < settings->heading_count; at.heading++) {
            const double cosine = settings->cosines[at.heading], sine = settings->sines[at.heading];
            ptrdiff_t any;
            if (around.cells)
                draw(around, others, cosine, sine, row, &any, &any);
            draw(map, object, cosine, sine, row, &at.first, &at.last);
            for (at.line = 0; at.line < ny - 2; at.line++)
                scan_line(&at, around, lowest);
        }
        qsort(best->heap, (size_t)best->count, sizeof(Run *), by_list);
        for (ptrdiff_t i = 0; i < best->count; i++) {
            best->heap[i]->terms[HOLD_ANGLE] = worse_angle(best->heap[i]->slopes);
            for (int term = 0; term < HOLD_TERMS; term++)
                holds[term * MEASURED + i] = best->heap[i]->terms[term];
        }
        result->count = best->count;
    }
    const int failed = !(memory && bins && best);
    free(memory);
    free(bins);
    free(best);
    return failed ? OUT_OF_MEMORY : 0;
}
