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

/* Which of the chosen pixels share a surface with fewer than two of their neighbours: `points`, of double precision
 * (`wide`) or single, of an image of so many columns. */
int find_single_pixels(const void *points, int wide, ptrdiff_t pixels, ptrdiff_t columns, const int64_t *chosen,
                       ptrdiff_t count, unsigned char *single);

/* How far such points are from the origin, squared, and whether that is from the nearest to the farthest, squared, too. */
void square_distances(const void *points, int wide, ptrdiff_t count, double nearest, double farthest, void *squared,
                      unsigned char *valid);

/* How far such points are above a plane; NaN where they are not valid. */
void rise_over_plane(const void *points, int wide, const unsigned char *valid, ptrdiff_t count, const double plane[4],
                     void *heights);

/* The points of the pixels, h × w × 3, of whose rays `along` (w × 3) and `down` (h × 3) are the parts. */
void find_positions(const float *q, ptrdiff_t h, ptrdiff_t w, const float *along, const float *down, float *positions);

/* 1 / depth of points (count × 3) of double precision (`wide`) or single. towards: depth is its first three · point less
 * the fourth. */
void invert_depths(const void *points, int wide, const unsigned char *valid, ptrdiff_t count, const double towards[4],
                   float *q);

/* Means of what lies about the median of block × block pixels. out: (h / block) × (w / block). */
int reduce_blocks(const float *q, ptrdiff_t h, ptrdiff_t w, ptrdiff_t block, float *out);

/* Of each pixel its inverse depth on a plane, to which columns (w) and rows (h) add, and its height, which falls evenly
 * with the depth from the camera's. */
void find_heights(const float *q, ptrdiff_t h, ptrdiff_t w, const float *across, const float *down, float camera,
                  float *plane, float *height);

/* The table, which is bent against its plane, and by how much pixels are nearer than it; 0 where nothing is measured. */
void rise_over_table(const float *q, const float *plane, const float *bend, ptrdiff_t pixels, float *table, float *above);

/* The mean of the measured ones among each pixel and its eight neighbours, none of which counts for more than `most`. */
int mean_of_nine(const float *values, const float *q, ptrdiff_t h, ptrdiff_t w, float most, float *mean);

/* What stands out of the table: pixels over all three, if together they are enough over the noise of means, `level`. */
typedef struct {
    const float *inverse_depth, *above, *mean, *height;
    float least_own, least_mean, least_height, level;
} Standing;

int stand_out(const Standing *from, ptrdiff_t h, ptrdiff_t w, unsigned char *out);

/* What is asked to tell wrinkles of a table from things. camera: m above it. */
typedef struct {
    const float *inverse_depth, *above;
    const int32_t *labels;
    const unsigned char *stands_out;
    ptrdiff_t h, w;
    float camera;
} Rising;

/* Fills `found` for patches 0 … patches − 1. */
int find_wrinkles(const Rising *image, ptrdiff_t patches, unsigned char *found);

/* Numbers of points: three of each plane that is drawn; for `half` of them others, of which the nearest two take the
 * place of the last two of the three; those that planes are tested on; how many more planes are level. */
enum { NEARBY = 16 };

typedef struct {
    const int64_t *corners, *drawn, *tested;
    ptrdiff_t hypotheses, half, tests, level;
} Draws;

/* Whether any was found; `up` may be NULL. */
int draw_plane(const double *points, ptrdiff_t count, const Draws *draws, const double *up, double least_cosine,
               double distance, double best[4]);

/* Changes plane (4), width and sets the residual. */
int refine_plane(const double *points, ptrdiff_t count, const double band[2], double *plane, double *width, double *residual);

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

/* Such sums of patches or groups 0 … count − 1. with_table: whether one was found. */
typedef struct {
    const double *sums, *bins, *sides;
    ptrdiff_t count;
    int with_table;
} PatchSums;

/* Pairs of patches, and whether both lie behind one, or at one hole. */
typedef struct {
    const int64_t *first, *second;
    const unsigned char *behind_one, *at_hole;
    ptrdiff_t count;
} Pairs;

enum { OF_BOTH = 57, OF_GROUP = 21 };

/* Features of pairs (count × OF_BOTH) and groups (count × OF_GROUP); `up` may be NULL. */
int describe_pairs(const PatchSums *patches, const Pairs *pairs, const double *up, float *features);
void describe_groups(const PatchSums *groups, const double *up, float *features);

/* The surfaces at both sides of borders. up (3): NULL where there is no table. */
typedef struct {
    const float *fitted, *slopes, *normals, *positions, *height;
    const int32_t *labels;
    const double *up;
    ptrdiff_t h, w;
} BorderImage;

/* Pixels across borders, as in patch_pairs.Borders. */
typedef struct {
    const int64_t *inner, *outer, *steps, *forward;
    const unsigned char *along_row;
    ptrdiff_t count;
} PixelPairs;

/* Whose borders they are: pair k's are from start[k] to start[k + 1]; sums and sides of the patches. */
typedef struct {
    const int64_t *start, *first, *second, *adjoining;
    const double *sums, *sides;
    ptrdiff_t pairs, count;
} BorderPatches;

enum { AT_BORDER = 30 };

/* Features of pairs (pairs × AT_BORDER), and how many pixel pairs show the first one and the second one in front. */
int describe_borders(const BorderImage *image, const PixelPairs *pairs, const BorderPatches *patches, float *features,
                     int64_t *in_front);

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
