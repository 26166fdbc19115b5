/* See frame.distances, flying_pixels.single_pixels and planes.heights_above: what is asked of all points of a frame, in their own type. */
#include "segmentation.h"

#include <math.h>

#define SAME_SURFACE 4e-4 /* m² */

#define LOOK_AT_POINTS(real)                                                                                           \
    /* Whether a pixel and the one at `other` are on one surface; beyond the image's ends is a corner of it. */        \
    static int are_near_##real(const real *points, ptrdiff_t pixels, ptrdiff_t own, ptrdiff_t other)                   \
    {                                                                                                                  \
        const real *at = points + 3 * own, *to = points + 3 * (other < 0 ? 0 : other >= pixels ? pixels - 1 : other);  \
        const real x = to[0] - at[0], y = to[1] - at[1], z = to[2] - at[2];                                            \
        return x * x + y * y + z * z < (real)SAME_SURFACE;                                                             \
    }                                                                                                                  \
                                                                                                                       \
    static void find_single_##real(const real *points, ptrdiff_t pixels, ptrdiff_t columns, const int64_t *chosen,     \
                                   ptrdiff_t count, unsigned char *single)                                             \
    {                                                                                                                  \
        static const int row[8] = {0, -1, 0, 1, -1, -1, 1, 1}, step[8] = {1, 0, -1, 0, -1, 1, -1, 1};                  \
        for (ptrdiff_t i = 0; i < count; i++) {                                                                        \
            const ptrdiff_t own = (ptrdiff_t)chosen[i], column = own % columns;                                        \
            int near = 0;                                                                                              \
            for (int k = 0; k < 8 && near < 2; k++)                                                                    \
                if (column + step[k] >= 0 && column + step[k] < columns)                                               \
                    near += are_near_##real(points, pixels, own, own + row[k] * columns + step[k]);                    \
            single[i] = near < 2;                                                                                      \
        }                                                                                                              \
    }                                                                                                                  \
                                                                                                                       \
    static void square_##real(const real *points, ptrdiff_t count, double nearest, double farthest, real *squared,     \
                              unsigned char *valid)                                                                    \
    {                                                                                                                  \
        const real least = (real)nearest, most = (real)farthest;                                                       \
        for (ptrdiff_t i = 0; i < count; i++) {                                                                        \
            const real x = points[3 * i], y = points[3 * i + 1], z = points[3 * i + 2];                                \
            squared[i] = x * x + y * y + z * z;                                                                        \
        }                                                                                                              \
        for (ptrdiff_t i = 0; i < count; i++)                                                                          \
            valid[i] = (squared[i] >= least) & (squared[i] <= most);                                                   \
    }                                                                                                                  \
                                                                                                                       \
    static void rise_##real(const real *points, const unsigned char *valid, ptrdiff_t count, const double plane[4],    \
                            real *heights)                                                                             \
    {                                                                                                                  \
        const real a = (real)plane[0], b = (real)plane[1], c = (real)plane[2], d = (real)plane[3];                     \
        for (ptrdiff_t i = 0; i < count; i++) {                                                                        \
            const real high = a * points[3 * i] + b * points[3 * i + 1] + c * points[3 * i + 2] + d;                   \
            heights[i] = valid[i] ? high : (real)NAN;                                                                  \
        }                                                                                                              \
    }

LOOK_AT_POINTS(float)
LOOK_AT_POINTS(double)

int find_single_pixels(const void *points, int wide, ptrdiff_t pixels, ptrdiff_t columns, const int64_t *chosen,
                       ptrdiff_t count, unsigned char *single)
{
    for (ptrdiff_t i = 0; i < count; i++)
        if (chosen[i] < 0 || chosen[i] >= pixels)
            return OUT_OF_RANGE;
    if (wide)
        find_single_double(points, pixels, columns, chosen, count, single);
    else
        find_single_float(points, pixels, columns, chosen, count, single);
    return 0;
}

void square_distances(const void *points, int wide, ptrdiff_t count, double nearest, double farthest, void *squared,
                      unsigned char *valid)
{
    if (wide)
        square_double(points, count, nearest, farthest, squared, valid);
    else
        square_float(points, count, nearest, farthest, squared, valid);
}

void rise_over_plane(const void *points, int wide, const unsigned char *valid, ptrdiff_t count, const double plane[4],
                     void *heights)
{
    if (wide)
        rise_double(points, valid, count, plane, heights);
    else
        rise_float(points, valid, count, plane, heights);
}
