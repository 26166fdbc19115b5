/* See patch_measures.sums_reference: sums over the pixels of each patch, in the order of the pixels. */
#include "segmentation.h"

#include <math.h>

enum { POWERS = 5 };
#define BIN_PER_M 500.0f /* BINS / TALLEST */
#define LOW 0.012f
#define FAR_OUT 20.0f
#define LITTLE_OUT 2.0f

/* Add a pixel to its patch's sums. */
static void add_pixel(const Measured *image, ptrdiff_t pixel, const double across[POWERS], const double down[POWERS],
                      double *restrict sum)
{
    static const int column[6] = {0, 1, 0, 2, 1, 0}, row[6] = {0, 0, 1, 0, 1, 2};
    const double q = image->inverse_depth[pixel], edge = image->edge[pixel];
    const float over = image->above[pixel] / (float)image->noise;
    double place[3];
    *sum++ += 1.0;
    for (int i = 0; i < POWERS; i++)
        for (int j = 0; j < POWERS - i; j++)
            *sum++ += across[i] * down[j];
    for (int k = 0; k < 6; k++)
        *sum++ += across[column[k]] * down[row[k]] * q;
    *sum++ += q * q;
    for (int k = 0; k < 3; k++)
        *sum++ += place[k] = image->positions[3 * pixel + k];
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++)
            *sum++ += place[i] * place[j];
    for (int k = 0; k < 3; k++)
        *sum++ += image->normals[3 * pixel + k];
    *sum++ += image->pixel * image->pixel / (q * q);
    *sum++ += edge > 2.0 ? 2.0 : edge;
    *sum++ += minimum(over, FAR_OUT);
    *sum++ += over < LITTLE_OUT;
}

/* Count a side of a pixel by what it is beside. pixel: that, −1 outside of the image. */
static void count_side(const Measured *image, ptrdiff_t pixel, int32_t own, float height, double sides[SIDES])
{
    if (pixel < 0) {
        sides[0]++;
        sides[4]++;
    } else if (image->labels[pixel] != own) {
        sides[0]++;
        if (image->labels[pixel])
            return;
        if (image->table[pixel]) {
            sides[1]++;
            sides[2] += height < LOW;
        } else if (!(image->inverse_depth[pixel] > 0.0f)) {
            sides[3]++;
        }
    }
}

static void raise(double value, double powers[POWERS])
{
    powers[0] = 1.0;
    for (int k = 1; k < POWERS; k++)
        powers[k] = powers[k - 1] * value;
}

int measure_patches(const Measured *image, ptrdiff_t count, double *sums, double *bins, double *sides)
{
    const ptrdiff_t h = image->h, w = image->w;
    for (ptrdiff_t row = 0; row < h; row++) {
        double down[POWERS], across[POWERS];
        raise(((double)row - (double)(h - 1) / 2.0) * image->pixel, down);
        for (ptrdiff_t column = 0; column < w; column++) {
            const ptrdiff_t pixel = row * w + column;
            const int32_t own = image->labels[pixel];
            if (!own)
                continue;
            if (own < 0 || own >= count)
                return OUT_OF_RANGE;
            raise(((double)column - (double)(w - 1) / 2.0) * image->pixel, across);
            add_pixel(image, pixel, across, down, sums + SUMS * (ptrdiff_t)own);
            double *side = sides + SIDES * (ptrdiff_t)own;
            const float height = image->height[pixel];
            if (isfinite(height)) {
                const float bin = height * BIN_PER_M;
                bins[BINS * (ptrdiff_t)own + (bin > 0.0f ? (ptrdiff_t)(bin < BINS - 1 ? bin : BINS - 1) : 0)]++;
            }
            count_side(image, column < w - 1 ? pixel + 1 : -1, own, height, side);
            count_side(image, column > 0 ? pixel - 1 : -1, own, height, side);
            count_side(image, row < h - 1 ? pixel + w : -1, own, height, side);
            count_side(image, row > 0 ? pixel - w : -1, own, height, side);
        }
    }
    return 0;
}
