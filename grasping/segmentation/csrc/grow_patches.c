/* See surface_patches.grow_patches_reference: patches grow level by level, one ring of pixels at a time. */
#include "segmentation.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LEVELS = 5, NEIGHBOURS = 4, LEAST_SEED = 12, LEAST_PATCH = 6 };
static const float LEVEL[LEVELS] = {0.25f, 0.4f, 0.6f, 1.0f, FLT_MAX};
#define CONTINUOUS 0.03f

/* The image in a frame of one pixel, and the lists of pixels that are dealt with. */
typedef struct {
    ptrdiff_t steps[NEIGHBOURS]; /* to the right, below, to the left, above */
    float *edge, *fitted;
    int32_t *labels;
    unsigned char *is_open; /* up to the level, and of no patch yet */
    int32_t *waiting; /* of no patch yet, by rising number */
    int32_t *front, *next; /* the rings */
    int32_t *taken;
    ptrdiff_t waiting_count;
} Growth;

static inline int goes_over(const Growth *growth, ptrdiff_t from, ptrdiff_t to)
{
    return fabsf(growth->fitted[from] - growth->fitted[to]) < CONTINUOUS;
}

/* The label that a pixel takes from a neighbour; 0 where none has one. */
static inline int32_t label_beside(const Growth *growth, ptrdiff_t pixel)
{
    for (int k = 0; k < NEIGHBOURS; k++) {
        const ptrdiff_t from = pixel + growth->steps[k];
        if (growth->labels[from] && goes_over(growth, from, pixel))
            return growth->labels[from];
    }
    return 0;
}

/* Give open pixels the label of a neighbour, ring after ring. */
static void grow(Growth *growth)
{
    ptrdiff_t count = 0;
    for (ptrdiff_t i = 0; i < growth->waiting_count; i++) {
        const ptrdiff_t pixel = growth->waiting[i];
        if (growth->is_open[pixel] && (growth->taken[count] = label_beside(growth, pixel)))
            growth->front[count++] = (int32_t)pixel;
    }
    while (count > 0) {
        ptrdiff_t found = 0;
        for (ptrdiff_t i = 0; i < count; i++) {
            growth->labels[growth->front[i]] = growth->taken[i];
            growth->is_open[growth->front[i]] = 0;
        }
        for (ptrdiff_t i = 0; i < count; i++)
            for (int k = 0; k < NEIGHBOURS; k++) {
                const ptrdiff_t pixel = growth->front[i] + growth->steps[k];
                if (growth->is_open[pixel] && goes_over(growth, growth->front[i], pixel)) {
                    growth->is_open[pixel] = 0;
                    growth->next[found++] = (int32_t)pixel;
                }
            }
        for (ptrdiff_t i = 0; i < found; i++) /* all of a ring before any of it has a label */
            growth->taken[i] = label_beside(growth, growth->next[i]);
        int32_t *swap = growth->front;
        growth->front = growth->next;
        growth->next = swap;
        count = found;
    }
}

/* New patches of open pixels that hang together, `least` of them or more; returns the number of all patches. */
static int32_t seed(Growth *growth, int32_t patches, ptrdiff_t least)
{
    for (ptrdiff_t i = 0; i < growth->waiting_count; i++) {
        if (!growth->is_open[growth->waiting[i]])
            continue;
        int32_t *piece = growth->front;
        ptrdiff_t count = 1;
        piece[0] = growth->waiting[i];
        growth->is_open[piece[0]] = 0;
        for (ptrdiff_t done = 0; done < count; done++)
            for (int k = 0; k < NEIGHBOURS; k++) {
                const ptrdiff_t pixel = piece[done] + growth->steps[k];
                if (growth->is_open[pixel]) {
                    growth->is_open[pixel] = 0;
                    piece[count++] = (int32_t)pixel;
                }
            }
        if (count < least)
            continue;
        patches++;
        for (ptrdiff_t k = 0; k < count; k++)
            growth->labels[piece[k]] = patches;
    }
    return patches;
}

ptrdiff_t grow_patches(const float *edge, const float *fitted, ptrdiff_t h, ptrdiff_t w, int32_t *labels)
{
    const ptrdiff_t width = w + 2, size = width * (h + 2);
    const size_t each = 2 * sizeof(float) + 5 * sizeof(int32_t) + 1;
    char *memory = malloc((size_t)size * each);
    if (!memory)
        return OUT_OF_MEMORY;
    Growth growth = {.steps = {1, width, -1, -width}};
    growth.waiting = (int32_t *)memory;
    growth.front = growth.waiting + size;
    growth.next = growth.front + size;
    growth.taken = growth.next + size;
    growth.edge = (float *)(growth.taken + size);
    growth.fitted = growth.edge + size;
    growth.labels = (int32_t *)(growth.fitted + size);
    growth.is_open = (unsigned char *)(growth.labels + size);
    memset(growth.labels, 0, (size_t)size * (sizeof(*growth.labels) + 1)); /* what is of no patch and not open is not read */
    for (ptrdiff_t row = 0; row < h; row++)
        for (ptrdiff_t column = 0; column < w; column++) {
            const ptrdiff_t pixel = (row + 1) * width + column + 1;
            if (!(edge[row * w + column] <= LEVEL[LEVELS - 1]))
                continue;
            growth.edge[pixel] = edge[row * w + column];
            growth.fitted[pixel] = fitted[row * w + column];
            growth.waiting[growth.waiting_count++] = (int32_t)pixel;
        }
    int32_t patches = 0;
    for (int level = 0; level < LEVELS; level++) {
        for (ptrdiff_t i = 0; i < growth.waiting_count; i++)
            growth.is_open[growth.waiting[i]] = growth.edge[growth.waiting[i]] <= LEVEL[level];
        grow(&growth);
        patches = seed(&growth, patches, level < LEVELS - 1 ? LEAST_SEED : LEAST_PATCH);
        ptrdiff_t kept = 0;
        for (ptrdiff_t i = 0; i < growth.waiting_count; i++) {
            growth.is_open[growth.waiting[i]] = 0;
            if (!growth.labels[growth.waiting[i]])
                growth.waiting[kept++] = growth.waiting[i];
        }
        growth.waiting_count = kept;
    }
    for (ptrdiff_t row = 0; row < h; row++)
        memcpy(labels + row * w, growth.labels + (row + 1) * width + 1, (size_t)w * sizeof(*labels));
    free(memory);
    return patches;
}
