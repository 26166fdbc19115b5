/* See pieces.label_pieces: what of a mask hangs together, numbered by the first pixel of each. */
#include "segmentation.h"

#include <stdlib.h>

ptrdiff_t label_pieces(const unsigned char *mask, ptrdiff_t h, ptrdiff_t w, int32_t *labels)
{
    int32_t *waiting = malloc((size_t)(h * w) * sizeof(*waiting)), count = 0;
    const int32_t width = (int32_t)w, last = (int32_t)((h - 1) * w); /* pixels are counted in int32, as labels are */
    if (!waiting)
        return OUT_OF_MEMORY;
    for (ptrdiff_t pixel = 0; pixel < h * w; pixel++)
        labels[pixel] = mask[pixel] ? -1 : 0;
    for (ptrdiff_t first = 0; first < h * w; first++) {
        if (labels[first] >= 0)
            continue;
        ptrdiff_t left = 1;
        waiting[0] = (int32_t)first;
        labels[first] = ++count;
        while (left > 0) {
            const int32_t pixel = waiting[--left], column = pixel % width;
            const int32_t beside[4] = {pixel - width, column > 0 ? pixel - 1 : -1, column < width - 1 ? pixel + 1 : -1,
                                       pixel < last ? pixel + width : -1};
            for (int k = 0; k < 4; k++)
                if (beside[k] >= 0 && labels[beside[k]] < 0) {
                    labels[beside[k]] = count;
                    waiting[left++] = beside[k];
                }
        }
    }
    free(waiting);
    return count;
}
