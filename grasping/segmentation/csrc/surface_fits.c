/* See surface_fits.fit_surfaces: planes fitted to the inverse depth around pixels, a block of neighbours at a time. */
#include "segmentation.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LANES = 16, MARGIN = 3 };
#define CONTINUOUS 0.04f
#define CLOSE 0.007f
#define FEWEST 6.0f

/* Sums over neighbours, for each lane. What is counted adds up to whole numbers, which are exact in any order: several
 * share an integer. low: 1, column + 3 and column² at bits 0, 8 and 16; high: row + 3, row² and column · row + 9. */
typedef struct {
    float q[LANES], cq[LANES], rq[LANES];
    int low[LANES], high[LANES];
} Sums;

typedef struct {
    float along_c[LANES], along_r[LANES], middle[LANES];
} Planes;

/* Add the neighbour in this column, counted from the lanes' own. */
#define ADD(column)                                                                                                    \
    do {                                                                                                               \
        const float at = there[lane + (column)], apart = at - own[lane];                                               \
        float off = apart;                                                                                             \
        if (refined)                                                                                                   \
            off = apart - (middle + along_c * (float)(column) + along_r);                                              \
        const int near = (at > 0.0f) & (fabsf(off) < (refined ? CLOSE : CONTINUOUS)) ? -1 : 0;                         \
        const float counted = choose(near, apart, 0.0f);                                                               \
        q += counted;                                                                                                  \
        cq += counted * (float)(column);                                                                               \
        rq += counted * (float)row;                                                                                    \
        low += near & (1 + (((column) + 3) << 8) + ((column) * (column) << 16));                                       \
        high += near & (above + (((column) * row + 9) << 16));                                                         \
    } while (0)

/* Add those neighbours of one row that `columns` adds. there: of the lanes' own column in that row. refined: whether
 * they must lie close to the planes, or just to the pixel itself. */
#define ADD_ROW(name, refined_, columns)                                                                               \
    static void name(const float *restrict there, const float *restrict own, const Planes *restrict planes, int row,   \
                     Sums *restrict sums)                                                                              \
    {                                                                                                                  \
        const int refined = refined_, above = row + 3 + (row * row << 8);                                              \
        for (int lane = 0; lane < LANES; lane++) {                                                                     \
            const float middle = planes->middle[lane], along_c = planes->along_c[lane];                                \
            const float along_r = planes->along_r[lane] * (float)row;                                                  \
            float q = sums->q[lane], cq = sums->cq[lane], rq = sums->rq[lane];                                         \
            int low = sums->low[lane], high = sums->high[lane];                                                        \
            columns;                                                                                                   \
            sums->q[lane] = q;                                                                                         \
            sums->cq[lane] = cq;                                                                                       \
            sums->rq[lane] = rq;                                                                                       \
            sums->low[lane] = low;                                                                                     \
            sums->high[lane] = high;                                                                                   \
        }                                                                                                              \
    }

ADD_ROW(add_all, 0, ADD(-2); ADD(-1); ADD(0); ADD(1); ADD(2))
ADD_ROW(add_odd, 1, ADD(-3); ADD(-1); ADD(1); ADD(3))
ADD_ROW(add_even, 1, ADD(-2); ADD(0); ADD(2))

/* Least squares. */
static inline void solve(const Sums *restrict sums, Planes *restrict planes)
{
    for (int lane = 0; lane < LANES; lane++) {
        const int low = sums->low[lane], high = sums->high[lane], number = low & 255;
        const float n = (float)number, c = (float)((low >> 8 & 255) - 3 * number), r = (float)((high & 255) - 3 * number);
        const float q = sums->q[lane], inverse = 1.0f / (n >= 1.0f ? n : 1.0f);
        const float mean_c = c * inverse, mean_r = r * inverse, mean_q = q * inverse;
        const float cc = (float)(low >> 16) - c * mean_c;
        const float cr = (float)((high >> 16) - 9 * number) - c * mean_r;
        const float rr = (float)(high >> 8 & 255) - r * mean_r;
        const float cq = sums->cq[lane] - c * mean_q, rq = sums->rq[lane] - r * mean_q;
        const float determinant = cc * rr - cr * cr;
        const int good = (n >= FEWEST) & (determinant > 1.0f);
        const float divisor = good ? determinant : 1.0f;
        const float along_c = (rr * cq - cr * rq) / divisor, along_r = (cc * rq - cr * cq) / divisor;
        planes->along_c[lane] = good ? along_c : 0.0f;
        planes->along_r[lane] = good ? along_r : 0.0f;
        planes->middle[lane] = mean_q - planes->along_c[lane] * mean_c - planes->along_r[lane] * mean_r;
    }
}

/* The planes about LANES pixels. at: the first of them, in an image of this width with a margin. */
static void fit(const float *at, ptrdiff_t width, Planes *planes)
{
    float own[LANES];
    Planes first;
    Sums sums;
    memcpy(own, at, sizeof(own));
    memset(&sums, 0, sizeof(sums));
    memset(&first, 0, sizeof(first));
    for (int row = -2; row <= 2; row++)
        add_all(at + row * width, own, &first, row, &sums);
    solve(&sums, &first);
    memset(&sums, 0, sizeof(sums));
    for (int row = -3; row <= 3; row++) /* every second pixel */
        (row & 1 ? add_odd : add_even)(at + row * width, own, &first, row, &sums);
    solve(&sums, planes);
}

/* Of length one towards the camera, as three rows of LANES. */
static void find_normals(const Planes *restrict planes, const float *restrict fitted, ptrdiff_t row, ptrdiff_t column,
                         const float *restrict to_frame, float normals[3][LANES])
{
    for (int lane = 0; lane < LANES; lane++) {
        const float along_c = planes->along_c[lane], along_r = planes->along_r[lane];
        const float at_origin = fitted[lane] - along_c * (float)((int)column + lane) - along_r * (float)row;
        float away[3];
        for (int k = 0; k < 3; k++)
            away[k] = along_c * to_frame[k] + along_r * to_frame[3 + k] + at_origin * to_frame[6 + k];
        const float length = sqrtf(away[0] * away[0] + away[1] * away[1] + away[2] * away[2]);
        const float scale = -1.0f / maximum(length, 1e-12f);
        for (int k = 0; k < 3; k++)
            normals[k][lane] = away[k] * scale;
    }
}

int fit_surfaces(const float *q, ptrdiff_t h, ptrdiff_t w, const int64_t *asked, ptrdiff_t count, const float *to_frame,
                 float *fitted, float *slopes, float *normals)
{
    const ptrdiff_t width = w + 2 * MARGIN;
    float *framed = calloc((size_t)(width * (h + 2 * MARGIN) + LANES), sizeof(*framed)); /* a block may begin at the end */
    if (!framed)
        return OUT_OF_MEMORY;
    for (ptrdiff_t row = 0; row < h; row++)
        memcpy(framed + (row + MARGIN) * width + MARGIN, q + row * w, (size_t)w * sizeof(*q));
    int code = 0;
    for (ptrdiff_t i = 0; i < count;) {
        const int64_t first = asked[i];
        if (first < 0 || first >= h * w) {
            code = OUT_OF_RANGE;
            break;
        }
        const ptrdiff_t row = first / w, column = first - row * w;
        const ptrdiff_t end = first + (w - column < LANES ? w - column : LANES);
        const float *at = framed + (row + MARGIN) * width + column + MARGIN;
        float there[LANES], across[3][LANES];
        Planes planes;
        fit(at, width, &planes);
        for (int lane = 0; lane < LANES; lane++)
            there[lane] = at[lane] + planes.middle[lane];
        find_normals(&planes, there, row, column, to_frame, across);
        for (; i < count && asked[i] >= first && asked[i] < end; i++) {
            const int64_t pixel = asked[i], lane = pixel - first;
            fitted[pixel] = there[lane];
            slopes[2 * pixel] = planes.along_c[lane];
            slopes[2 * pixel + 1] = planes.along_r[lane];
            for (int k = 0; k < 3; k++)
                normals[3 * pixel + k] = across[k][lane];
        }
    }
    free(framed);
    return code;
}
