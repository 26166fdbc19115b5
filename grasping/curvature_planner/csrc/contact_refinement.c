/* contact_refinement.refine: holds looked at closely, on all points. */
#include "planner.h"

#include <math.h>
#include <stdlib.h>

enum { CONTOUR_ROWS = 5, STEPS = 2 };
static const double TOUCHING = 0.006, ROUGHNESS = 0.003, CONTACT_BAND = 0.004, BESIDE = 0.003, SEARCH = 0.006;
static const double MOST_TURN = 0.15, HAIR = 1e-9, LEAST_WIDTH = 0.002;

/* A closing axis through (x, y), and what the coordinates along and across it are measured from. */
typedef struct {
    double cosine, sine, along, across;
} Axis;

static Axis axis_of(double heading, double x, double y)
{
    Axis axis = {cos(heading), sin(heading), 0.0, 0.0};
    axis.along = axis.cosine * x + axis.sine * y;
    axis.across = axis.cosine * y - axis.sine * x;
    return axis;
}

static double along(const Axis *axis, double x, double y) { return (axis->cosine * x + axis->sine * y) - axis->along; }
static double across(const Axis *axis, double x, double y) { return (axis->cosine * y - axis->sine * x) - axis->across; }

/* The outermost coordinates on either side, in each row of the pad's width; those of the second side backwards. */
typedef struct {
    double least[2][CONTOUR_ROWS];
} Contour;

/* Points between the pads: rows u (along), v (across) and height, of `capacity` each. */
typedef struct {
    double *u, *v, *height;
    ptrdiff_t count;
} Strip;

/* Of the points those above the tip and between the pads. */
static void gather(
    Strip *strip, const FootprintGrid *grid, const Axis *axis, double x, double y, double tip, double half, double reach)
{
    const Points points = grid->points;
    Span spans[MOST_LINES];
    const int lines = spans_in(grid, x, y, axis->cosine, axis->sine, -reach, reach, half, spans);
    ptrdiff_t count = 0;
    for (int line = 0; line < lines; line++)
        for (ptrdiff_t i = spans[line].first; i < spans[line].stop; i++) {
            const double u = along(axis, points.x[i], points.y[i]), v = across(axis, points.x[i], points.y[i]);
            strip->u[count] = u; /* written always and kept sometimes: a branch would be guessed wrong */
            strip->v[count] = v;
            strip->height[count] = points.height[i];
            count += (fabs(v) <= half) & (fabs(u) <= reach) & (points.height[i] > tip);
        }
    strip->count = count;
}

static Contour draw_contour(const Strip *strip, double half)
{
    Contour contour;
    for (int side = 0; side < 2; side++)
        for (int row = 0; row < CONTOUR_ROWS; row++)
            contour.least[side][row] = INFINITY;
    for (ptrdiff_t i = 0; i < strip->count; i++) {
        const double u = strip->u[i];
        const int row = (int)((strip->v[i] + half) * (CONTOUR_ROWS / (2 * half)));
        double *least = &contour.least[0][row < CONTOUR_ROWS ? row : CONTOUR_ROWS - 1];
        least[0] = u < least[0] ? u : least[0];
        least[CONTOUR_ROWS] = -u < least[CONTOUR_ROWS] ? -u : least[CONTOUR_ROWS];
    }
    return contour;
}

static double outermost(const double contour[CONTOUR_ROWS])
{
    double least = contour[0];
    for (int row = 1; row < CONTOUR_ROWS; row++)
        least = contour[row] < least ? contour[row] : least;
    return least;
}

/* Least-squares slope of a contour over those of its rows that are there; 0 where fewer than two are. */
static double slope(const double contour[CONTOUR_ROWS], double pad_width)
{
    int count = 0;
    double mean = 0.0, product = 0.0, square = 0.0;
    for (int row = 0; row < CONTOUR_ROWS; row++)
        if (isfinite(contour[row])) {
            mean += row * (pad_width / CONTOUR_ROWS);
            count++;
        }
    mean /= count > 1 ? count : 1;
    for (int row = 0; row < CONTOUR_ROWS; row++)
        if (isfinite(contour[row])) {
            const double v = row * (pad_width / CONTOUR_ROWS) - mean;
            product += v * contour[row];
            square += v * v;
        }
    return product / (square > 1e-12 ? square : 1e-12);
}

/* Share of the pad that touches, from how far each row of the contour lies behind the outermost point. */
static double support(const double contour[CONTOUR_ROWS], double outermost)
{
    double sum = 0.0;
    for (int row = 0; row < CONTOUR_ROWS; row++) {
        const double share = (TOUCHING - (contour[row] - outermost)) / (TOUCHING - ROUGHNESS);
        sum += share > 0.0 ? (share < 1.0 ? share : 1.0) : 0.0;
    }
    return sum / CONTOUR_ROWS;
}

/* Area of the pad beside the surface that it touches, the lesser side; 0 where too few points say that there is one. */
static double touched_area(
    const Strip *strip, double tip, const double outer[2], double half, double fewest)
{
    double area[2];
    for (int side = 0; side < 2; side++) {
        double top[CONTOUR_ROWS];
        int points = 0;
        for (int row = 0; row < CONTOUR_ROWS; row++)
            top[row] = tip;
        for (ptrdiff_t i = 0; i < strip->count; i++) {
            if (!((side ? -strip->u[i] : strip->u[i]) <= outer[side] + TOUCHING))
                continue;
            const int row = (int)((strip->v[i] + half) * (CONTOUR_ROWS / (2 * half)));
            double *highest = &top[row < CONTOUR_ROWS ? row : CONTOUR_ROWS - 1];
            *highest = greatest(*highest, strip->height[i]);
            points++;
        }
        area[side] = 0.0;
        for (int row = 0; row < CONTOUR_ROWS; row++)
            area[side] += (top[row] - tip) * (2.0 * half / CONTOUR_ROWS);
        area[side] = points < fewest ? 0.0 : area[side];
    }
    return least(area[0], area[1]);
}

/* How far the surface that each side touches stands above the tip, the lower one. */
static double overlap(const Strip *strip, double tip, const double outer[2])
{
    double top[2] = {-INFINITY, -INFINITY};
    for (ptrdiff_t i = 0; i < strip->count; i++) {
        const double height = strip->height[i];
        if (strip->u[i] <= outer[0] + CONTACT_BAND && height > top[0])
            top[0] = height;
        if (-strip->u[i] <= outer[1] + CONTACT_BAND && height > top[1])
            top[1] = height;
    }
    return (top[1] < top[0] ? top[1] : top[0]) - tip;
}

/* Free space beside start … end from `nearest` on; 0 where anything in between is higher than the palm. */
static double gap(
    const FootprintGrid *grid, const Axis *axis, double x, double y, double tip, double half, double start, double end,
    double nearest, double palm, double most)
{
    const double middle = 0.5 * (start + end), half_width = 0.5 * (end - start);
    const Points points = grid->points;
    Span spans[MOST_LINES];
    const int lines =
        spans_in(grid, x, y, axis->cosine, axis->sine, start - most, end + most, half + BESIDE, spans);
    for (int line = 0; line < lines; line++)
        for (ptrdiff_t i = spans[line].first; i < spans[line].stop; i++) {
            const double distance = fabs(along(axis, points.x[i], points.y[i]) - middle) - half_width;
            const int beside = distance < most && distance >= nearest, under = distance < 0.0 && points.height[i] > palm;
            if ((beside || under) && points.height[i] > tip &&
                fabs(across(axis, points.x[i], points.y[i])) <= half + BESIDE)
                most = under ? 0.0 : distance;
        }
    return most;
}

int refine_holds(
    const FootprintGrid *object, const FootprintGrid *others, const double *heading, const double *x, const double *y,
    const double *tip, const double *width, ptrdiff_t count, double pad_width, double wished_room, double reach,
    double fewest, double *contacts)
{
    const size_t most = (size_t)object->points.count + 1; /* one more than are kept is written */
    double *memory = malloc(3 * sizeof(double) * most);
    if (!memory)
        return OUT_OF_MEMORY;
    Strip strip = {memory, memory + most, memory + 2 * most, 0};
    const double half = 0.5 * pad_width;
    for (ptrdiff_t i = 0; i < count; i++) {
        const double search = 0.5 * width[i] + SEARCH;
        double turned = heading[i], at_x = x[i], at_y = y[i], from_x, from_y;
        Axis axis = axis_of(turned, at_x, at_y);
        Contour contour;
        double slopes[2], outer[2], start, end;
        int empty;
        for (int step = 0;; step++) {
            from_x = at_x;
            from_y = at_y;
            gather(&strip, object, &axis, from_x, from_y, tip[i], half, search);
            contour = draw_contour(&strip, half);
            slopes[0] = slope(contour.least[0], pad_width);
            slopes[1] = -slope(contour.least[1], pad_width);
            outer[0] = outermost(contour.least[0]);
            outer[1] = outermost(contour.least[1]);
            empty = !isfinite(outer[0]) || strip.count < 3;
            if (empty)
                outer[0] = outer[1] = 0.0;
            start = outer[0];
            end = -outer[1];
            const double middle = 0.5 * (start + end);
            at_x += axis.cosine * middle;
            at_y += axis.sine * middle;
            if (step == STEPS)
                break;
            const double turn = atan(0.5 * (slopes[0] + slopes[1]));
            turned -= turn > MOST_TURN ? MOST_TURN : (turn < -MOST_TURN ? -MOST_TURN : turn);
            axis = axis_of(turned, at_x, at_y);
        }
        const double one = support(contour.least[0], outer[0]), other = support(contour.least[1], outer[1]);
        const double left = fabs(atan(slopes[0])), right = fabs(atan(slopes[1]));
        double *to = contacts + i;
        to[CONTACT_HEADING * count] = turned;
        to[CONTACT_X * count] = at_x;
        to[CONTACT_Y * count] = at_y;
        to[CONTACT_WIDTH * count] = end - start;
        to[CONTACT_ANGLE * count] = right > left ? right : left;
        to[CONTACT_SHARE * count] = other < one ? other : one;
        to[CONTACT_OVERLAP * count] = empty ? 0.0 : overlap(&strip, tip[i], outer);
        /* What is nearer to the object than TOUCHING belongs to the contact itself. */
        const double free_space = gap(object, &axis, from_x, from_y, tip[i], half, start, end, TOUCHING, INFINITY,
                                      wished_room);
        to[CONTACT_GAP * count] = gap(others, &axis, from_x, from_y, tip[i], half, start, end, 0.0, tip[i] + reach,
                                      free_space);
        double thickest = -INFINITY;
        for (int row = 0; row < CONTOUR_ROWS; row++)
            thickest = greatest(thickest, -contour.least[1][row] - contour.least[0][row]);
        to[CONTACT_AREA * count] = empty || thickest < LEAST_WIDTH ? 0.0 : touched_area(&strip, tip[i], outer, half, fewest);
        to[CONTACT_EMPTY * count] = empty;
    }
    free(memory);
    return 0;
}

int measured_between(
    Points seen, const double axes[9], const double origin[3], const double *heading, const double *x, const double *y,
    const double *tip, const double *width, ptrdiff_t count, double pad_width, double *numbers, double *along_it,
    double *across_it)
{
    if ((size_t)seen.count > SIZE_MAX / (3 * sizeof(double)) - 1)
        return OUT_OF_MEMORY;
    double *local = malloc((size_t)(seen.count + 1) * 3 * sizeof(double));
    if (!local)
        return OUT_OF_MEMORY;
    const Points from = {origin, origin + 1, origin + 2, 1};
    for (int axis = 0; axis < 3; axis++) {
        const double start = project_point(from, 0, axes, axis);
        for (ptrdiff_t i = 0; i < seen.count; i++)
            local[axis * seen.count + i] = project_point(seen, i, axes, axis) - start;
    }
    seen = (Points){local, local + seen.count, local + 2 * seen.count, seen.count};
    for (ptrdiff_t hold = 0; hold < count; hold++) {
        const Axis axis = axis_of(heading[hold], x[hold], y[hold]);
        const double half = 0.5 * width[hold] + HAIR;
        double first = INFINITY, last = -INFINITY, left = INFINITY, right = -INFINITY, number = 0.0;
        for (ptrdiff_t i = 0; i < seen.count; i++) {
            const double v = across(&axis, seen.x[i], seen.y[i]);
            if (!(fabs(v) <= 0.5 * pad_width))
                continue;
            const double u = along(&axis, seen.x[i], seen.y[i]);
            if (!((fabs(u) <= half) & (seen.height[i] > tip[hold])))
                continue;
            first = least(first, u);
            last = greatest(last, u);
            left = least(left, v);
            right = greatest(right, v);
            number += 1.0;
        }
        numbers[hold] = number;
        along_it[hold] = number > 0.0 ? last - first : 0.0;
        across_it[hold] = number > 0.0 ? right - left : 0.0;
    }
    free(local);
    return 0;
}
