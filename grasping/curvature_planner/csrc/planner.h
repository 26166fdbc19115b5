/* The compiled half of the planner's hot path; every function repeats a NumPy reference of this package bit for bit.
 *
 * That is why nothing here may be contracted or reordered by the compiler (see setup.py), why ties are broken by an
 * index and why angles come from the C library, which the reference calls through Python's `math`.
 * All lengths in m, angles in rad. Nothing here touches Python: callers may release the interpreter's lock. */
#ifndef GRASPING_PLANNER_H
#define GRASPING_PLANNER_H

#include <stddef.h>
#include <stdint.h>

#define OUT_OF_MEMORY (-1)
#define TOO_LARGE (-2)
#define PI 3.14159265358979323846

/* The first number where the second is not less (greater), also where that is NaN. */
static inline double least(double a, double b) { return b < a ? b : a; }
static inline double greatest(double a, double b) { return b > a ? b : a; }

/* Points seen along the approach: rows of an array (3, count). */
typedef struct {
    const double *x, *y, *height;
    ptrdiff_t count;
} Points;

/* Points as they come in: an array (count, 3). */
typedef struct {
    const double *at;
    ptrdiff_t count;
} Rows;

/* The coordinate of a point along the axis in this column of axes (3 × 3 by rows). */
static inline double project_point(Points cloud, ptrdiff_t i, const double axes[9], int column)
{
    return (axes[column] * cloud.x[i] + axes[3 + column] * cloud.y[i]) + axes[6 + column] * cloud.height[i];
}

/* Sort indices of keys (count) by rising key; equal ones keep their order. spare, bits: (count) to work in. */
void sort_indices(const double *keys, ptrdiff_t count, int64_t *order, int64_t *spare, uint64_t *bits);

/* projection.py. axes: 3 × 3 by rows; its columns are the axes. Points here are in the cloud's frame, `height` its z. */

/* The direction in the plane of the first two axes across the points (cell 0), or across the footprint each of whose
 * square cells counts once. Returns 0 or an error. */
int short_side(Points cloud, const double axes[9], double cell, double axis[2]);

/* One point, the highest, of each box: 1 × 1 × `depth` of at least `box`. thinned: (3, count). Returns their number. */
ptrdiff_t thin_cloud(Points cloud, const double axes[9], double box, double depth, double *thinned);

/* The cloud along its axes, in rising height, with the origin in its middle and at the table's height (NaN: of the lowest
 * point). local: (3, count). Returns 0 or an error. */
int place_cloud(
    Points cloud, const double axes[9], double table_height, double cell, double *local, double middle[3],
    double footprint[4]);

/* The highest in each cell of others along the axes, in rising height, from `middle` and within ± `reach` of it. local:
 * (3, others.count), of which each row's first are written. Returns their number or an error. */
ptrdiff_t neighbours_of(
    Rows others, const double axes[9], const double middle[3], const double reach[2], double cell, double *local);

/* line_of_sight.py */
#define SIGHT_PIXELS 96
#define LENS 15

/* Depth images: lenses (count, LENS), depth (count, SIGHT_PIXELS, SIGHT_PIXELS). */
typedef struct {
    const double *lenses, *depth;
    ptrdiff_t count;
} Sight;

/* Draw the depth (SIGHT_PIXELS, SIGHT_PIXELS) of a cloud, of others, and of ends of lines on which nothing was measured.
 * Returns the share of the cloud's points that others of it hide, or an error. */
double look_from(Points cloud, Rows others, Rows unseen, const double eye[3], double lens[LENS], double *depth);

/* The same images for places along axes (3 × 3 by rows) from an origin; `turned->lenses` is to be freed, whatever is
 * returned: 0 or an error. */
int turn_sight(const Sight *sight, const double axes[9], const double origin[3], Sight *turned);

/* How little is known of a place: 0 looked through from a viewpoint, or there is none; 1 not measured; 2 behind a surface. */
int doubt(const Sight *sight, double x, double y, double height);

/* unseen_back.py. viewpoints: (sight.count, 3). found: (capacity, 3), in the cloud's frame. Returns the number of places
 * or an error. */
ptrdiff_t assume_back(
    Points cloud, const double up[3], double floor, double cell, const double *viewpoints, const Sight *sight,
    double *found, ptrdiff_t capacity);

/* finger_scan.py */
enum { HOLD_HEADING, HOLD_X, HOLD_Y, HOLD_TIP, HOLD_WIDTH, HOLD_OVERLAP, HOLD_ANGLE, HOLD_ROOM, HOLD_WHOLE, HOLD_TERMS };
#define MEASURED 160

typedef struct {
    const double *tips, *headings, *cosines, *sines;
    ptrdiff_t tip_count, heading_count;
    double pad_width, wished_room, greatest_width, reach, centre_x, centre_y;
    int finger, wished; /* bins of free space that a finger needs beside the object, and had better have */
} ScanSettings;

typedef struct {
    ptrdiff_t count;
    double too_wide, narrowest;
} ScanResult;

/* holds: (HOLD_TERMS, MEASURED), of which each row's first `count` are written. Returns 0 or an error. */
int scan_holds(Points object, Points others, const ScanSettings *settings, double *holds, ScanResult *result);

/* Points in square cells of the plane: `points` by lines along x, those of one cell in the order that they had, and where
 * in it each cell starts. */
#define MOST_LINES 64

typedef struct {
    Points points;
    ptrdiff_t *starts, lines, columns;
    double x, y, cell;
} FootprintGrid;

typedef struct {
    ptrdiff_t first, stop;
} Span;

/* Returns 0 or an error. What was never laid out, and is zero, may be discarded, too. */
int lay_out(Points points, FootprintGrid *grid);
void discard(FootprintGrid *grid);

/* Spans of a grid's points that hold all of those in a rectangle, and others near it: from `start` to `end` along an axis
 * through (x, y), and `half` to either side of it. Returns their number. */
int spans_in(
    const FootprintGrid *grid, double x, double y, double cosine, double sine, double start, double end, double half,
    Span spans[MOST_LINES]);

/* contact_refinement.py */
enum {
    CONTACT_HEADING, CONTACT_X, CONTACT_Y, CONTACT_WIDTH, CONTACT_ANGLE, CONTACT_SHARE, CONTACT_OVERLAP, CONTACT_GAP,
    CONTACT_AREA, CONTACT_EMPTY, CONTACT_TERMS
};

/* heading … width: arrays of `count` coarse holds. contacts: (CONTACT_TERMS, count). Returns 0 or an error. */
int refine_holds(
    const FootprintGrid *object, const FootprintGrid *others, const double *heading, const double *x, const double *y, const double *tip,
    const double *width, ptrdiff_t count, double pad_width, double wished_room, double reach, double fewest, double *contacts);

/* contact_refinement.measured. seen: in the cloud's frame, in any order; heading … width: arrays of `count` holds along the
 * axes from the origin; numbers: how many of the points are between the pads of each; along, across: how far those reach
 * along its closing axis and across it. Returns 0 or an error. */
int measured_between(
    Points seen, const double axes[9], const double origin[3], const double *heading, const double *x, const double *y,
    const double *tip, const double *width, ptrdiff_t count, double pad_width, double *numbers, double *along_it,
    double *across_it);

/* ranking.py. Numbers only, in the order of ranking.Rules. */
typedef struct {
    double pad_width, stroke, finger_thickness, finger_room, wished_room, greatest_width, reach;
    double steepest, parallel, blurred; /* angles of contacts that slip; are as good as parallel; cost all in the scan */
    double least_overlap, least_points, least_contact, least_area, narrowest;
    double blind, least_measured, least_breadth, least_reach, assumed; /* ranking._held_by_what_was_seen */
    double most_clearance, far_from_centre;
    double refined, alike_place, alike_heading, alike_tip;                  /* scoring.best_unlike */
    double place, heading, width, same_place, same_heading, sag, slide;     /* grasp_clusters.cluster */
    double slid, centred, candidates;
    double bite, bite_span;                                                 /* scoring.bite_term */
    double shallow, deep, deepest, shallow_share, deep_share, deepest_share; /* scoring.overlap_term */
    double coarse_total, total;                                             /* sums of weights */
    double w_coarse_centre;
    double w_contact, w_bite, w_angle, w_overlap, w_centre, w_room, w_narrow, w_whole, w_seen;
} Rules;

enum {
    RANKED_SCORE = CONTACT_TERMS, RANKED_TIP, RANKED_WHOLE, RANKED_BITE, RANKED_ANGLE, RANKED_OVERLAP, RANKED_CENTRE, RANKED_ROOM,
    RANKED_NARROW, RANKED_SEEN, RANKED_OPENING, RANKED_ASSUMED, RANKED_TERMS
};
#define MOST_TRIED 64

/* sight, measured (none: all of the object was): in the cloud's frame, in which the object and the rest are along axes (3 × 3 by rows) from an origin.
 * holds: rows of an array (HOLD_TERMS, stride). ranked: (RANKED_TERMS, MOST_TRIED). problems: MOST_TRIED numbers of what
 * speaks against each hold where none holds. Returns the number of ranked ones or an error; *refused: of problems. */
ptrdiff_t rank_holds(
    Points object, Points others, const Sight *sight, Points measured, const double axes[9], const double origin[3],
    const double *holds, ptrdiff_t stride, ptrdiff_t count,
    double centre_x, double centre_y, const Rules *rules, double *ranked, int64_t *problems, ptrdiff_t *refused);

/* region_report.py */
enum { PART_SLAB, PART_CLUSTER, PART_START, PART_STOP, PART_FLAT, PART_SEEN, PART_HELD, PART_COUNTS };
enum { PART_LOW_X, PART_LOW_Y, PART_HIGH_X, PART_HIGH_Y, PART_CURVATURE, PART_MEASURES };

/* order: (count) of the object's points, by slab and then along x. parts: (object.count, PART_COUNTS); measures:
 * (object.count, PART_MEASURES). Returns the number of parts or an error. */
ptrdiff_t survey_regions(
    Points object, const double *hold_x, const double *hold_y, ptrdiff_t hold_count, double slab_height, double flat,
    int64_t *order, int64_t *parts, double *measures);

#endif
