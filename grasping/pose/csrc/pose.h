/* The compiled loops of the pose estimator; every function repeats a NumPy reference of this package bit for bit.
 *
 * That is why nothing here may be contracted or reordered by the compiler (see setup.py), and why sums are added up in
 * the order of the reference's. Poses are 4 × 4 by rows. Nothing here touches Python: callers may release the
 * interpreter's lock. */
#ifndef GRASPING_POSE_H
#define GRASPING_POSE_H

#include <stddef.h>
#include <stdint.h>

#define OUT_OF_MEMORY (-1)
#define OUT_OF_RANGE (-2)

#define SIDES 6
#define SAME_SIDE 0.5    /* as in alignment.py */
#define ALONG 0.02       /* likewise */
#define RESTS 1e-6       /* likewise */
#define DAMPED 1e-6      /* likewise */
#define GRAZING 0.2      /* as in sight_check.py */
#define STEEP 0.35       /* likewise */
#define BUFFER 64        /* likewise */
#define BEHIND 2.0       /* likewise */
#define NEAREST 1e-3     /* as in view.py */
#define DISTANCES 21     /* as in point_pairs.py, like the next three */
#define ANGLES 15
#define CELLS (DISTANCES * ANGLES * ANGLES * ANGLES)
#define SPREAD 0.25

/* A table of pairs by cells, and the pairs of a scene, by row. */
typedef struct {
    const int32_t *starts, *first, *turn;
    ptrdiff_t entries, points;
    int32_t turns, fine;
} Table;

/* Fills found (rows × peaks × 3). row, bins (× 4), turn: of `count` pairs. */
int count_votes(const Table *table, const int32_t *row, const double *bins, const int32_t *turn, ptrdiff_t count,
                ptrdiff_t rows, ptrdiff_t peaks, int32_t *found);

/* The model's surface and its nearest points: a grid of x × y × z, six of each cell. */
typedef struct {
    const double *points, *normals, *corner, *centre;
    const int32_t *nearest;
    ptrdiff_t count, x, y, z;
    double cell;
} Grid;

int check_grid(const Grid *grid);

/* The partner of a scene's point with its normal at a pose, or −1; place: the point in the object frame. */
ptrdiff_t find_partner(const Grid *grid, const double *point, const double *normal, const double *T, double *place);

/* Fills normals (asked × 3), of either sign, of the planes through the `neighbours` points, at most `count`,
 * that are nearest to each place. points: (count × 3) in the order of one coordinate, `axis`. */
int fit_normals(const double *points, ptrdiff_t count, const double *places, ptrdiff_t asked, ptrdiff_t axis,
                ptrdiff_t neighbours, double *normals);

/* One step a gate of each of `poses` poses T. */
void align_poses(const Grid *grid, const double *points, const double *normals, ptrdiff_t count, const double *gates,
                 ptrdiff_t steps, double *T, ptrdiff_t poses);

/* What the camera saw: h × w pixels. */
typedef struct {
    const double *near, *far;
    ptrdiff_t h, w;
    double left, top, pitch;
} View;

/* Fills sums (poses × 4) of what the model's points would be at poses T_view_object. */
int look_at_poses(const View *view, const double *points, const double *normals, ptrdiff_t count, const double *T,
                  ptrdiff_t poses, double coarse, double tolerance, double *sums);

#endif
