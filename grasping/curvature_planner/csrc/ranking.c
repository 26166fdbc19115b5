/* ranking.rank: from the holds of the coarse scan to the middles of the best places. */
#include "planner.h"

#include <math.h>
#include <stdlib.h>

/* Where a finger's way is looked at: outward in shares of the room that it needs, across in pad widths, and in height. */
enum { WAY_OUTWARD = 2, WAY_LEVELS = 4, COARSE_LEVELS = 2 };
enum { TOUCHES_NOTHING = 1 }; /* of ranking.PROBLEMS */
static const double WAY_ACROSS[3] = {-0.4, 0.0, 0.4};

/* A hold that was looked at closely; its score is −INFINITY where something speaks against it. */
typedef struct {
    double of[RANKED_TERMS];
    int problem;
} Tried;

typedef struct {
    Tried tried[MOST_TRIED];
    ptrdiff_t count;
} Found;

/* What a hold is looked at with: rows of equal length. */
typedef struct {
    double heading[MOST_TRIED], x[MOST_TRIED], y[MOST_TRIED], tip[MOST_TRIED], width[MOST_TRIED], whole[MOST_TRIED];
    ptrdiff_t best[MOST_TRIED]; /* index of the best hold at the place */
    ptrdiff_t count;
} Places;

typedef struct {
    FootprintGrid object, others;
    double top; /* height of the object's highest point */
    const Sight *sight;
    double centre_x, centre_y;
    const Rules *rules;
} Scene;

static double clip(double share)
{
    share = share > 0.0 ? share : 0.0;
    return share < 1.0 ? share : 1.0;
}

static double overlap_term(const Rules *rules, double overlap)
{
    return rules->shallow_share * clip(overlap / rules->shallow) + rules->deep_share * clip(overlap / rules->deep) +
           rules->deepest_share * clip(overlap / rules->deepest);
}

static double centre_term(const Scene *scene, double x, double y)
{
    const double dx = x - scene->centre_x, dy = y - scene->centre_y;
    return clip(1.0 - sqrt(dx * dx + dy * dy) / scene->rules->far_from_centre);
}

/* The term "narrow": what is as good as nothing is no better than what is too wide. */
static double narrow_term(const Rules *rules, double width)
{
    return least(clip(1.0 - width / rules->stroke), clip(width / rules->narrowest));
}

/* Share of the fingers' way beside a hold that was seen, what was not measured by half, the worse side; on lines at these places across the pad. */
static double seen_term(
    const Scene *scene, double heading, double x, double y, double tip, double width, const double *across, int lines,
    int levels)
{
    static const double OUTWARD[WAY_OUTWARD] = {0.25, 0.75};
    const Rules *rules = scene->rules;
    if (!scene->sight->count)
        return 1.0;
    const double cosine = cos(heading), sine = sin(heading);
    const double above = scene->top - tip;
    const int all = 2 * WAY_OUTWARD * levels * lines;
    int fewest = all;
    for (int side = 1; side >= -1; side -= 2) {
        int seen = 0;
        for (int out = 0; out < WAY_OUTWARD; out++)
            for (int line = 0; line < lines; line++) {
                const double u = side * (0.5 * width + OUTWARD[out] * rules->finger_room);
                const double v = across[line] * rules->pad_width;
                const double at_x = (x + cosine * u) - sine * v, at_y = (y + sine * u) + cosine * v;
                for (int level = 0; level < levels; level++)
                    seen += 2 - doubt(scene->sight, at_x, at_y, tip + above * ((double)level / levels));
            }
        fewest = seen < fewest ? seen : fewest;
    }
    return (double)fewest / (double)all;
}

static double coarse_score(const Scene *scene, const double *hold, ptrdiff_t stride)
{
    const Rules *rules = scene->rules;
    const double overlap = hold[HOLD_OVERLAP * stride];
    double score = 0.0;
    score += rules->w_angle * clip(1.0 - hold[HOLD_ANGLE * stride] / rules->blurred);
    score += rules->w_overlap * overlap_term(rules, overlap);
    score += rules->w_coarse_centre * centre_term(scene, hold[HOLD_X * stride], hold[HOLD_Y * stride]);
    score += rules->w_room * hold[HOLD_ROOM * stride];
    score += rules->w_narrow * narrow_term(rules, hold[HOLD_WIDTH * stride]);
    score += rules->w_whole * hold[HOLD_WHOLE * stride];
    score += rules->w_seen * seen_term(scene, hold[HOLD_HEADING * stride], hold[HOLD_X * stride],
                                       hold[HOLD_Y * stride], hold[HOLD_TIP * stride], hold[HOLD_WIDTH * stride],
                                       &WAY_ACROSS[1], 1, COARSE_LEVELS);
    score /= rules->coarse_total;
    return overlap >= rules->least_overlap ? score : score - 1.0;
}

/* The best holds, each unlike those before it in place, heading or depth. */
static Places best_unlike(const Scene *scene, const double *holds, ptrdiff_t stride, ptrdiff_t count)
{
    const Rules *rules = scene->rules;
    const double *heading = holds + HOLD_HEADING * stride, *x = holds + HOLD_X * stride, *y = holds + HOLD_Y * stride;
    const double *tip = holds + HOLD_TIP * stride;
    double score[MEASURED];
    Places chosen;
    for (ptrdiff_t i = 0; i < count; i++)
        score[i] = coarse_score(scene, holds + i, stride);
    for (chosen.count = 0; chosen.count < (ptrdiff_t)rules->refined; chosen.count++) {
        ptrdiff_t best = 0;
        for (ptrdiff_t i = 1; i < count; i++)
            best = score[i] > score[best] ? i : best;
        if (!(score[best] > -INFINITY))
            break;
        const ptrdiff_t to = chosen.count;
        chosen.heading[to] = heading[best];
        chosen.x[to] = x[best];
        chosen.y[to] = y[best];
        chosen.tip[to] = tip[best];
        chosen.width[to] = holds[HOLD_WIDTH * stride + best];
        chosen.whole[to] = holds[HOLD_WHOLE * stride + best];
        for (ptrdiff_t i = 0; i < count; i++) {
            const double angle = fabs(heading[i] - heading[best]), turn = PI - angle < angle ? PI - angle : angle;
            const double dx = x[i] - x[best], dy = y[i] - y[best];
            if (dx * dx + dy * dy < rules->alike_place * rules->alike_place && turn < rules->alike_heading &&
                fabs(tip[i] - tip[best]) < rules->alike_tip)
                score[i] = -INFINITY;
        }
        score[best] = -INFINITY;
    }
    return chosen;
}

/* Score a hold from its contacts, or say what speaks against it. */
static void judge(const Scene *scene, Tried *hold)
{
    const Rules *rules = scene->rules;
    double *of = hold->of;
    const double width = of[CONTACT_WIDTH], angle = of[CONTACT_ANGLE], overlap = of[CONTACT_OVERLAP];
    const double gap = of[CONTACT_GAP];
    const int against[] = {
        of[CONTACT_EMPTY] > 0.0,
        of[CONTACT_AREA] < rules->least_area,
        width > rules->greatest_width,
        gap < rules->finger_room,
        overlap < rules->least_overlap,
        angle > rules->steepest,
        of[CONTACT_SHARE] < rules->least_contact,
    };
    hold->problem = -1;
    for (int i = 6; i >= 0; i--)
        hold->problem = against[i] ? i : hold->problem;
    double clear = gap - rules->finger_thickness > 0.0 ? gap - rules->finger_thickness : 0.0;
    clear = clear < rules->most_clearance ? clear : rules->most_clearance;
    const double opening = width + 2.0 * clear;
    of[RANKED_BITE] = clip((overlap - rules->bite) / rules->bite_span);
    of[RANKED_ANGLE] = clip((rules->steepest - angle) / (rules->steepest - rules->parallel));
    of[RANKED_OVERLAP] = overlap_term(rules, overlap);
    of[RANKED_CENTRE] = centre_term(scene, of[CONTACT_X], of[CONTACT_Y]);
    of[RANKED_ROOM] = clip((gap - rules->finger_room) / (rules->wished_room - rules->finger_room));
    of[RANKED_NARROW] = narrow_term(rules, width);
    of[RANKED_SEEN] = hold->problem >= 0 ? 0.0 : seen_term(
        scene, of[CONTACT_HEADING], of[CONTACT_X], of[CONTACT_Y], of[RANKED_TIP], width, WAY_ACROSS, 3, WAY_LEVELS);
    of[RANKED_OPENING] = opening < rules->stroke ? opening : rules->stroke;
    double score = 0.0;
    score += rules->w_contact * of[CONTACT_SHARE];
    score += rules->w_bite * of[RANKED_BITE];
    score += rules->w_angle * of[RANKED_ANGLE];
    score += rules->w_overlap * of[RANKED_OVERLAP];
    score += rules->w_centre * of[RANKED_CENTRE];
    score += rules->w_room * of[RANKED_ROOM];
    score += rules->w_narrow * of[RANKED_NARROW];
    score += rules->w_whole * of[RANKED_WHOLE];
    score += rules->w_seen * of[RANKED_SEEN];
    of[RANKED_SCORE] = hold->problem < 0 ? score / rules->total : -INFINITY;
}

/* Look closely at holds and add them to those found. */
static int try_holds(const Scene *scene, const Places *holds, Found *found)
{
    double contacts[CONTACT_TERMS * MOST_TRIED];
    const ptrdiff_t count = holds->count;
    const int error = refine_holds(&scene->object, &scene->others, holds->heading, holds->x, holds->y, holds->tip,
                                   holds->width, count, scene->rules->pad_width, scene->rules->wished_room,
                                   scene->rules->reach, scene->rules->least_points, contacts);
    for (ptrdiff_t i = 0; !error && i < count && found->count < MOST_TRIED; i++) {
        Tried *hold = &found->tried[found->count++];
        for (int term = 0; term < CONTACT_TERMS; term++)
            hold->of[term] = contacts[term * count + i];
        hold->of[RANKED_TIP] = holds->tip[i];
        hold->of[RANKED_WHOLE] = holds->whole[i];
        judge(scene, hold);
    }
    return error;
}

/* An angle between axes without a sign, in [−π/2, π/2). */
static double half_turn(double angle)
{
    double rest = fmod(angle + 0.5 * PI, PI);
    if (rest < 0.0)
        rest += PI;
    return rest - 0.5 * PI;
}

static double distance(double x, double y) { return sqrt(x * x + y * y); }

/* The best places, at most so many: around the best hold left, until none is left. */
static Places places(const Found *found, const Rules *rules, ptrdiff_t most)
{
    Places there;
    int left[MOST_TRIED];
    double weight[MOST_TRIED], turn[MOST_TRIED];
    there.count = 0;
    for (ptrdiff_t i = 0; i < found->count; i++)
        left[i] = found->tried[i].problem < 0;
    while (there.count < most) {
        ptrdiff_t top = -1;
        for (ptrdiff_t i = 0; i < found->count; i++)
            if (left[i] && (top < 0 || found->tried[i].of[RANKED_SCORE] > found->tried[top].of[RANKED_SCORE]))
                top = i;
        if (top < 0)
            break;
        const double *best = found->tried[top].of;
        double sum = 0.0;
        for (ptrdiff_t i = 0; i < found->count; i++) {
            const double *of = found->tried[i].of;
            turn[i] = half_turn(of[CONTACT_HEADING] - best[CONTACT_HEADING]);
            const double away = distance(of[CONTACT_X] - best[CONTACT_X], of[CONTACT_Y] - best[CONTACT_Y]);
            const int near = found->tried[i].problem < 0 && of[RANKED_TIP] == best[RANKED_TIP] &&
                             fabs(of[CONTACT_WIDTH] - best[CONTACT_WIDTH]) < rules->width &&
                             fabs(turn[i]) < rules->heading && away < rules->place;
            left[i] = left[i] && !near;
            weight[i] = near ? exp((of[RANKED_SCORE] - best[RANKED_SCORE]) / rules->sag) : 0.0;
            sum += weight[i];
        }
        left[top] = 0;
        double heading = 0.0, x = 0.0, y = 0.0, width = 0.0, whole = 0.0;
        for (ptrdiff_t i = 0; i < found->count; i++) {
            const double *of = found->tried[i].of, share = weight[i] / sum;
            heading += share * turn[i];
            x += share * of[CONTACT_X];
            y += share * of[CONTACT_Y];
            width += share * of[CONTACT_WIDTH];
            whole += share * of[RANKED_WHOLE];
        }
        heading = best[CONTACT_HEADING] + heading;
        int known = 0;
        for (ptrdiff_t i = 0; i < there.count; i++)
            known |= there.tip[i] == best[RANKED_TIP] && distance(there.x[i] - x, there.y[i] - y) < rules->same_place &&
                     fabs(half_turn(there.heading[i] - heading)) < rules->same_heading;
        if (known)
            continue;
        const ptrdiff_t to = there.count++;
        there.heading[to] = heading;
        there.x[to] = x;
        there.y[to] = y;
        there.tip[to] = best[RANKED_TIP];
        there.width[to] = width;
        there.whole[to] = least(whole, 1.0);
        there.best[to] = top;
    }
    return there;
}

/* Holds beside the middles, as far as a scan may have left out: along the pads, not along the closing axis. */
static Places to_either_side(const Places *middles, double slide)
{
    Places beside = *middles;
    const ptrdiff_t count = middles->count;
    beside.count = 2 * count;
    for (ptrdiff_t i = 0; i < beside.count; i++) {
        const ptrdiff_t of = i < count ? i : i - count;
        const double offset = i < count ? -slide : slide, heading = middles->heading[of];
        beside.heading[i] = heading;
        beside.x[i] = middles->x[of] - offset * sin(heading);
        beside.y[i] = middles->y[of] + offset * cos(heading);
        beside.tip[i] = middles->tip[of];
        beside.width[i] = middles->width[of];
        beside.whole[i] = middles->whole[of];
    }
    return beside;
}

static void put(const Tried *hold, ptrdiff_t at, double *ranked)
{
    for (int term = 0; term < RANKED_TERMS; term++)
        ranked[term * MOST_TRIED + at] = hold->of[term];
}

static ptrdiff_t rank_in(
    const Scene *scene, const double *holds, ptrdiff_t stride, ptrdiff_t count, double *ranked, int64_t *problems,
    ptrdiff_t *refused)
{
    const Rules *rules = scene->rules;
    Found found, middles;
    found.count = middles.count = *refused = 0;
    const Places chosen = best_unlike(scene, holds, stride, count);
    int error = try_holds(scene, &chosen, &found);
    int any = 0;
    for (ptrdiff_t i = 0; i < found.count; i++)
        any |= found.tried[i].problem < 0;
    if (error || !any) {
        for (; !error && *refused < found.count; ++*refused)
            problems[*refused] = found.tried[*refused].problem;
        return error;
    }
    const Places best = places(&found, rules, (ptrdiff_t)rules->slid), beside = to_either_side(&best, rules->slide);
    error = try_holds(scene, &beside, &found);
    Places there = places(&found, rules, (ptrdiff_t)rules->candidates);
    const ptrdiff_t all = there.count;
    there.count = all < (ptrdiff_t)rules->centred ? all : (ptrdiff_t)rules->centred;
    error = error ? error : try_holds(scene, &there, &middles);
    if (error)
        return error;
    ptrdiff_t written = 0;
    int centred[MOST_TRIED] = {0};
    for (ptrdiff_t i = 0; i < middles.count; i++) {
        const double best_score = found.tried[there.best[i]].of[RANKED_SCORE];
        centred[i] = middles.tried[i].of[RANKED_SCORE] >= best_score - rules->sag;
        if (centred[i])
            put(&middles.tried[i], written++, ranked);
    }
    for (ptrdiff_t i = 0; i < all; i++)
        if (!centred[i])
            put(&found.tried[there.best[i]], written++, ranked);
    return written;
}

/* Of the ranked holds those between whose pads enough was measured, and none with a blind finger where there are others. */
static ptrdiff_t held_by_what_was_seen(
    const Rules *rules, Points measured, const double axes[9], const double origin[3], ptrdiff_t count, double *ranked,
    int64_t *problems, ptrdiff_t *refused)
{
    double number[MOST_TRIED], reach[MOST_TRIED], breadth[MOST_TRIED];
    double *score = ranked + RANKED_SCORE * MOST_TRIED, *assumed = ranked + RANKED_ASSUMED * MOST_TRIED;
    const double *width = ranked + CONTACT_WIDTH * MOST_TRIED, *seen = ranked + RANKED_SEEN * MOST_TRIED;
    const double *heading = ranked + CONTACT_HEADING * MOST_TRIED, *tip = ranked + RANKED_TIP * MOST_TRIED;
    const double *x = ranked + CONTACT_X * MOST_TRIED, *y = ranked + CONTACT_Y * MOST_TRIED;
    if (measured.count && measured_between(measured, axes, origin, heading, x, y, tip, width, count, rules->pad_width,
                                           number, reach, breadth))
        return OUT_OF_MEMORY;
    int any = 0;
    for (ptrdiff_t i = 0; i < count; i++)
        any |= seen[i] >= rules->blind;
    ptrdiff_t looked_at = 0, kept = 0;
    for (ptrdiff_t i = 0; i < count; i++) {
        if (any && !(seen[i] >= rules->blind))
            continue;
        looked_at++;
        assumed[i] = 0.0;
        if (measured.count) {
            if (!(number[i] >= rules->least_measured && breadth[i] >= rules->least_breadth &&
                  reach[i] >= rules->least_reach))
                continue;
            assumed[i] = greatest(width[i] - reach[i], 0.0);
            score[i] *= 1.0 - rules->assumed * (assumed[i] / width[i]);
        }
        for (int term = 0; term < RANKED_TERMS; term++)
            ranked[term * MOST_TRIED + kept] = ranked[term * MOST_TRIED + i];
        kept++;
    }
    for (*refused = 0; !kept && *refused < looked_at; ++*refused)
        problems[*refused] = TOUCHES_NOTHING;
    return kept;
}

ptrdiff_t rank_holds(
    Points object, Points others, const Sight *sight, Points measured, const double axes[9], const double origin[3],
    const double *holds, ptrdiff_t stride, ptrdiff_t count,
    double centre_x, double centre_y, const Rules *rules, double *ranked, int64_t *problems, ptrdiff_t *refused)
{
    Sight turned;
    Scene scene = {.top = object.height[object.count - 1], .sight = &turned, .centre_x = centre_x, .centre_y = centre_y,
                   .rules = rules};
    ptrdiff_t found = turn_sight(sight, axes, origin, &turned);
    found = found ? found : lay_out(object, &scene.object);
    found = found ? found : lay_out(others, &scene.others);
    if (!found)
        found = rank_in(&scene, holds, stride, count, ranked, problems, refused);
    if (found > 0)
        found = held_by_what_was_seen(rules, measured, axes, origin, found, ranked, problems, refused);
    discard(&scene.others);
    discard(&scene.object);
    free((double *)turned.lenses);
    return found;
}
