/* See wrinkles.wrinkles_reference: which low patches rise from the table little by little. */
#include "segmentation.h"
#include "selection.h"

#include <stdlib.h>

enum { REACH = 3 };
#define LOW 0.015f
#define MOSTLY 0.95
#define GRADUAL 0.5f
#define LEAST_FOOT 0.25
#define MOST 0.05f

SELECTION(select_float, float)

/* What is counted of each patch. */
typedef struct {
    int64_t *pixels, *high, *outline, *foot;
    ptrdiff_t *first_pixel, *first_side; /* where its own begin in `above` and `rise` */
    float *above, *rise;
} Counts;

/* The mean of the measured ones among nine pixels, in the order of mean_of_nine.c. */
static float mean_at(const Rising *image, ptrdiff_t pixel)
{
    const ptrdiff_t w = image->w, row = pixel / w, column = pixel - row * w;
    float total[3] = {0.0f, 0.0f, 0.0f}, number[3] = {0.0f, 0.0f, 0.0f};
    const int left = column > 0 ? 0 : 1, right = column < w - 1 ? 3 : 2;
    for (ptrdiff_t from = row > 0 ? row - 1 : 0; from <= row + 1 && from < image->h; from++) {
        const float *q = image->inverse_depth + from * w + column - 1, *above = image->above + from * w + column - 1;
        for (int k = left; k < right; k++) {
            const float limited = minimum(maximum(above[k], -MOST), MOST);
            total[k] += q[k] > 0.0f ? limited : 0.0f;
            number[k] += q[k] > 0.0f ? 1.0f : 0.0f;
        }
    }
    const float count = number[0] + number[1] + number[2];
    return (total[0] + total[1] + total[2]) / (count >= 1.0f ? count : 1.0f);
}

static int is_table(const Rising *image, ptrdiff_t pixel)
{
    return image->inverse_depth[pixel] > 0.0f && !image->stands_out[pixel] && !image->labels[pixel];
}

/* Whether from a patch's pixel on, step by step, there is table as far as the reach. */
static int sees_table(const Rising *image, ptrdiff_t pixel, ptrdiff_t step, ptrdiff_t room)
{
    if (room < REACH)
        return 0;
    for (int far = 1; far <= REACH; far++)
        if (!is_table(image, pixel + far * step))
            return 0;
    return 1;
}

/* By how much a patch has risen at a pixel beside the table. back: pixels behind it. */
static float rise_at(const Rising *image, ptrdiff_t pixel, ptrdiff_t step, ptrdiff_t back)
{
    const float own = mean_at(image, pixel);
    float high = own;
    for (int far = 1; far <= REACH; far++) {
        const ptrdiff_t inner = back >= far ? pixel - far * step : pixel;
        if (image->labels[inner] > 0)
            high = maximum(high, inner == pixel ? own : mean_at(image, inner));
    }
    return high - mean_at(image, pixel + REACH * step);
}

static int count_pixels(const Rising *image, ptrdiff_t patches, Counts *counts)
{
    for (ptrdiff_t i = 0; i < image->h * image->w; i++) {
        const int32_t own = image->labels[i];
        if (!own)
            continue;
        if (own < 0 || own >= patches)
            return OUT_OF_RANGE;
        counts->pixels[own]++;
        counts->high[own] += minimum(image->above[i], MOST) * image->camera > LOW * image->inverse_depth[i];
    }
    return 0;
}

/* Go along the sides of a pixel of a low patch: first they are counted, then what rises there is noted. */
static void look_around(const Rising *image, ptrdiff_t row, ptrdiff_t column, Counts *counts, int noting)
{
    const ptrdiff_t w = image->w, pixel = row * w + column;
    const ptrdiff_t steps[4] = {-w, w, -1, 1}, rooms[4] = {row, image->h - 1 - row, column, w - 1 - column};
    const int32_t own = image->labels[pixel];
    for (int side = 0; side < 4; side++) {
        if (rooms[side] > 0 && image->labels[pixel + steps[side]] == own)
            continue;
        if (!noting)
            counts->outline[own]++;
        else if (sees_table(image, pixel, steps[side], rooms[side]))
            counts->rise[counts->first_side[own] + counts->foot[own]++] =
                rise_at(image, pixel, steps[side], rooms[side ^ 1]);
    }
}

/* Whether a patch with so much of its outline along the table rises little by little. */
static int is_wrinkle(Counts *counts, ptrdiff_t patch)
{
    const ptrdiff_t pixels = counts->pixels[patch], foot = counts->foot[patch];
    if (!foot || !((double)foot >= LEAST_FOOT * (double)counts->outline[patch]))
        return 0;
    float *rise = counts->rise + counts->first_side[patch], *above = counts->above + counts->first_pixel[patch];
    const float risen = select_float(rise, 0, foot - 1, (ptrdiff_t)(0.5 * (double)(foot - 1)));
    return risen < GRADUAL * select_float(above, 0, pixels - 1, (ptrdiff_t)(0.75 * (double)(pixels - 1)));
}

int find_wrinkles(const Rising *image, ptrdiff_t patches, unsigned char *found)
{
    const ptrdiff_t size = image->h * image->w;
    int64_t *memory = calloc((size_t)patches + 1, 4 * sizeof(int64_t) + 2 * sizeof(ptrdiff_t));
    float *values = malloc((size_t)(5 * size) * sizeof(*values)); /* a pixel, and its four sides */
    if (!memory || !values) {
        free(memory);
        free(values);
        return OUT_OF_MEMORY;
    }
    Counts counts = {memory,           memory + patches, memory + 2 * patches, memory + 3 * patches, NULL, NULL, values,
                     values + size};
    counts.first_pixel = (ptrdiff_t *)(memory + 4 * patches);
    counts.first_side = counts.first_pixel + patches;
    const int code = count_pixels(image, patches, &counts);
    for (ptrdiff_t patch = 0; patch < patches && !code; patch++)
        found[patch] = patch && (double)counts.high[patch] <= (1 - MOSTLY) * (double)counts.pixels[patch];
    for (int noting = 0; noting < 2 && !code; noting++) {
        for (ptrdiff_t row = 0; row < image->h; row++)
            for (ptrdiff_t column = 0; column < image->w; column++) {
                const ptrdiff_t i = row * image->w + column;
                const int32_t own = image->labels[i];
                if (!own || !found[own])
                    continue;
                look_around(image, row, column, &counts, noting);
                if (noting)
                    counts.above[counts.first_pixel[own]++] = minimum(image->above[i], MOST);
            }
        ptrdiff_t pixels = 0, sides = 0;
        for (ptrdiff_t patch = 0; patch < patches; patch++) {
            counts.first_pixel[patch] = pixels;
            counts.first_side[patch] = sides;
            pixels += found[patch] ? counts.pixels[patch] : 0;
            sides += counts.outline[patch];
        }
    }
    for (ptrdiff_t patch = 0; patch < patches && !code; patch++)
        found[patch] = found[patch] && is_wrinkle(&counts, patch);
    free(memory);
    free(values);
    return code;
}
