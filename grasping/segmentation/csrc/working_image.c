/* See WorkingImage.positions and working_image.inverse_depths. */
#include "segmentation.h"

void find_positions(const float *q, ptrdiff_t h, ptrdiff_t w, const float *along, const float *down, float *positions)
{
    for (ptrdiff_t row = 0; row < h; row++)
        for (ptrdiff_t column = 0; column < w; column++) {
            const ptrdiff_t pixel = row * w + column;
            const float depth = q[pixel] > 0.0f ? 1.0f / q[pixel] : 0.0f;
            for (int k = 0; k < 3; k++)
                positions[3 * pixel + k] = (along[3 * column + k] + down[3 * row + k]) * depth;
        }
}

/* In the arithmetic of the points' own type. */
#define INVERT(name, real, least)                                                                                      \
    static void name(const real *points, const unsigned char *valid, ptrdiff_t count, const double towards[4], float *q) \
    {                                                                                                                  \
        const real x = (real)towards[0], y = (real)towards[1], z = (real)towards[2], back = (real)towards[3];          \
        for (ptrdiff_t i = 0; i < count; i++) {                                                                        \
            const real depth = x * points[3 * i] + y * points[3 * i + 1] + z * points[3 * i + 2] - back;               \
            q[i] = valid[i] && depth > least ? (float)((real)1 / depth) : 0.0f;                                        \
        }                                                                                                              \
    }

INVERT(invert_single, float, 1e-6f)
INVERT(invert_double, double, 1e-6)

void invert_depths(const void *points, int wide, const unsigned char *valid, ptrdiff_t count, const double towards[4],
                   float *q)
{
    if (wide)
        invert_double(points, valid, count, towards, q);
    else
        invert_single(points, valid, count, towards, q);
}
