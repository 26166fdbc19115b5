/* The compiled half of preprocessing one cloud: farthest point sampling, the published grouping, and fixed positions
 * that take their nearest points. Sampling and grouping repeat their references in NumPy and torch bit for bit; that is
 * why nothing here may be contracted or reordered by the compiler (see setup.py).
 * All lengths in m. Nothing here touches Python: callers may release the interpreter's lock. */
#ifndef PEC_PREPROCESSING_H
#define PEC_PREPROCESSING_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#define BLOCK 64       /* points among which the extreme one is looked for at once */
#define LANES 16       /* of which this many side by side */
#define FARTHEST 1e18f /* coordinate of which the square of a difference still is a float */

/* The same function for each set of instructions; the one that this processor has is chosen when the module is loaded.
 * No result depends on it. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__GLIBC__)
#define WIDE __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define WIDE
#endif

/* One row an axis, each padded to a multiple of BLOCK with zeros. */
typedef struct {
    float *x, *y, *z;
    ptrdiff_t count, padded;
} Rows;

/* Returns 0 where memory is short. To be freed: x. */
static inline int allocate(Rows *rows, ptrdiff_t count)
{
    rows->count = count;
    rows->padded = (count + BLOCK - 1) / BLOCK * BLOCK;
    rows->x = calloc(3 * (size_t)rows->padded, sizeof(float));
    rows->y = rows->x + rows->padded;
    rows->z = rows->y + rows->padded;
    return rows->x != NULL;
}

static inline float squared_length(float x, float y, float z) { return x * x + y * y + z * z; }

/* _sampling.c. cloud: (count, 3) of doubles if wide, else of floats. start: the first point, or −1 for the farthest from
 * the centroid. out: (n, 3), centred. Returns 0 where a number is not finite or too large for floats, −1 without memory,
 * else 1. */
int sample_cloud(const void *cloud, int wide, ptrdiff_t count, ptrdiff_t n, ptrdiff_t start, float *out);

/* _ordering.c. points: (n, 3). order (n): see ordering.group_order. To work in, size dividing n: spare (n), taken (n) of
 * zeros, sorted (2 n). */
void group_points(const float *points, ptrdiff_t n, ptrdiff_t size, int64_t *order, float *spare, char *taken,
                  int64_t *sorted);

/* Eigenvectors of a symmetric matrix as columns, of falling eigenvalues and right-handed: Jacobi's rotations. The matrix
 * is left diagonal, of the eigenvalues in another order. */
void principal_axes(double a[3][3], double axes[3][3]);

/* _description.c. points (n, 3), n at least 1; out (37). Returns 0 where memory is short. */
int describe_points(const float *points, ptrdiff_t n, double *out);

/* isolation.c. points (n, 3), finite; out (n): distance of each one's fourth nearest neighbour, infinite of fewer than
 * five. Returns 0 where memory is short. */
int isolations(const double *points, ptrdiff_t n, double *out);

/* forms.c. points (n, 3), n at least 2; out (78). Returns 0 where memory is short. */
int surface_forms(const float *points, ptrdiff_t n, double *out);

/* candidates (count, 3), anchors (n, 3), signs (views, 3), out (views, n, 3). Returns 0 where memory is short. */
int arrange_cloud(const float *candidates, ptrdiff_t count, const float *anchors, ptrdiff_t n, const float *signs,
                  ptrdiff_t views, int principal, int each_axis, float *out);

#endif
