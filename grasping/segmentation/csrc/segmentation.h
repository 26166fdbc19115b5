/* The compiled pixel loops of the segmenter; every function repeats a NumPy reference of this package bit for bit.
 *
 * That is why nothing here may be contracted or reordered by the compiler (see setup.py), and why sums are added up in
 * the order of the reference's. Images are h × w by rows, a pixel's number is row · w + column; inverse depths in 1/m.
 * Loops over neighbouring pixels are written for the compiler to vectorise. Nothing here touches Python: callers may
 * release the interpreter's lock. */
#ifndef GRASPING_SEGMENTATION_H
#define GRASPING_SEGMENTATION_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define OUT_OF_MEMORY (-1)
#define OUT_OF_RANGE (-2)

/* NumPy's: NaN if either is. */
static inline float maximum(float a, float b) { return (a >= b) | (a != a) ? a : b; }
static inline float minimum(float a, float b) { return (a <= b) | (a != a) ? a : b; }

/* The first number where all bits of `mask` are set, the second where none is: without a branch, in whatever loop. */
static inline float choose(int mask, float a, float b)
{
    int32_t bits, others;
    memcpy(&bits, &a, sizeof(bits));
    memcpy(&others, &b, sizeof(others));
    bits = (bits & mask) | (others & ~mask);
    memcpy(&a, &bits, sizeof(bits));
    return a;
}

/* The points of the pixels, h × w × 3, of whose rays `along` (w × 3) and `down` (h × 3) are the parts. */
void find_positions(const float *q, ptrdiff_t h, ptrdiff_t w, const float *along, const float *down, float *positions);

/* 1 / depth of points (count × 3) of double precision (`wide`) or single. towards: depth is its first three · point less
 * the fourth. */
void invert_depths(const void *points, int wide, const unsigned char *valid, ptrdiff_t count, const double towards[4],
                   float *q);

/* Means of what lies about the median of block × block pixels. out: (h / block) × (w / block). */
int reduce_blocks(const float *q, ptrdiff_t h, ptrdiff_t w, ptrdiff_t block, float *out);

/* The mean of the measured ones among each pixel and its eight neighbours. */
int mean_of_nine(const float *values, const unsigned char *measured, ptrdiff_t h, ptrdiff_t w, float *mean);

/* Fills `labels`; returns their number. */
ptrdiff_t label_pieces(const unsigned char *mask, ptrdiff_t h, ptrdiff_t w, int32_t *labels);

/* Planes about the asked-for pixels. to_frame: 3 × 3, from a plane's terms to its normal. slopes: h × w × 2, normals:
 * h × w × 3. Only what was asked for is written. */
int fit_surfaces(const float *q, ptrdiff_t h, ptrdiff_t w, const int64_t *asked, ptrdiff_t count, const float *to_frame,
                 float *fitted, float *slopes, float *normals);

/* How much of an edge each of the asked-for pixels is. Only what was asked for is written. */
int find_edges(const float *fitted, const float *slopes, const float *normals, const float *positions, ptrdiff_t h,
               ptrdiff_t w, const int64_t *asked, ptrdiff_t count, float *edge);

/* Fills `labels`; returns their number. */
ptrdiff_t grow_patches(const float *edge, const float *fitted, ptrdiff_t h, ptrdiff_t w, int32_t *labels);

/* Changes `labels` from 0 … count; returns the number that is left. */
ptrdiff_t merge_patches(const float *edge, ptrdiff_t h, ptrdiff_t w, int32_t *labels, ptrdiff_t count);

/* steps: 2 × h × w, along the rows and down the columns. */
void steps_to_borders(const int32_t *labels, const unsigned char *unknown, ptrdiff_t h, ptrdiff_t w, unsigned char *steps);

/* What `measure_patches` adds up, and over what. */
typedef struct {
    const float *inverse_depth, *normals, *positions, *edge, *height, *above;
    const int32_t *labels;
    const unsigned char *table;
    ptrdiff_t h, w;
    double pixel, noise;
} Measured;

enum { SUMS = 39, BINS = 256, SIDES = 5 };

/* Adds to rows 0 … count − 1 of sums, bins and sides. */
int measure_patches(const Measured *image, ptrdiff_t count, double *sums, double *bins, double *sides);

/* Trees as in boosted_trees.py. */
typedef struct {
    const int32_t *feature, *left, *right, *missing_left, *start;
    const float *threshold;
    const double *value;
    ptrdiff_t nodes, trees;
} Trees;

/* The same as they are asked, checked: `free` is due. */
typedef struct PackedTrees PackedTrees;

int pack_trees(const Trees *trees, PackedTrees **packed);

int add_trees(const PackedTrees *trees, const float *features, ptrdiff_t rows, ptrdiff_t columns, double *odds);

/* Fills root (nodes). */
int cluster(const int64_t *first, const int64_t *second, const double *agreement, ptrdiff_t pairs, ptrdiff_t nodes,
            int64_t *root);

#endif
