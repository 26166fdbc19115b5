/* See patch_pairs.steps_to_borders: how far it is from a patch's pixel to the next patch, along rows and columns. */
#include "segmentation.h"

enum { REACH = 5 };

/* The pixels to another patch `step` by `step`, of which `room` are in the image; 0 where none is found. */
static unsigned char steps_from(const int32_t *labels, const unsigned char *unknown, ptrdiff_t pixel, ptrdiff_t step,
                                ptrdiff_t room)
{
    const int32_t own = labels[pixel];
    for (ptrdiff_t steps = 1; steps <= REACH && steps <= room; steps++) {
        const ptrdiff_t there = pixel + steps * step;
        if (labels[there] > 0)
            return labels[there] != own ? (unsigned char)steps : 0;
        if (labels[there] < 0 || !unknown[there])
            return 0;
    }
    return 0;
}

void steps_to_borders(const int32_t *labels, const unsigned char *unknown, ptrdiff_t h, ptrdiff_t w, unsigned char *steps)
{
    for (ptrdiff_t row = 0; row < h; row++)
        for (ptrdiff_t column = 0; column < w; column++) {
            const ptrdiff_t pixel = row * w + column;
            if (labels[pixel]) {
                steps[pixel] = steps_from(labels, unknown, pixel, 1, w - 1 - column);
                steps[h * w + pixel] = steps_from(labels, unknown, pixel, w, h - 1 - row);
            } else {
                steps[pixel] = steps[h * w + pixel] = 0;
            }
        }
}
