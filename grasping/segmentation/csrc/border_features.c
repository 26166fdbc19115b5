/* See pair_features.border_features: what is known of the border of two patches, pixel pair by pixel pair. */
#include "segmentation.h"
#include "selection.h"

#include <math.h>
#include <stdlib.h>

enum { INNER = 2, QUANTILES = 5 };
#define MOST_JUMP 0.3
#define IN_FRONT 0.008

static const double QUANTILE[QUANTILES] = {0.1, 0.25, 0.5, 0.75, 0.9};
static const double ENDS[2] = {0.1, 0.9}, LOWER[2] = {0.1, 0.5};

SELECTION(select_number, double)

/* Of the pixel pairs of one border. */
typedef struct {
    double *jump, *turn, *size, *gap, *high; /* a number each */
    double far, steps, along_row, rising, apart; /* sums */
    int64_t level, first_in_front, second_in_front;
} Border;

/* The pixel some steps inside of its patch, or itself where that is narrower. ahead: −1 or 1. */
static ptrdiff_t inward(const BorderImage *image, ptrdiff_t pixel, int along_row, ptrdiff_t ahead)
{
    const ptrdiff_t room = along_row ? image->w : image->h, at = along_row ? pixel % image->w : pixel / image->w;
    const ptrdiff_t to = at + INNER * ahead, there = pixel + INNER * ahead * (along_row ? 1 : image->w);
    return to >= 0 && to < room && image->labels[there] == image->labels[pixel] ? there : pixel;
}

/* The inverse depth that a pixel's plane has in the middle between two others. */
static double at_middle(const BorderImage *image, ptrdiff_t pixel, ptrdiff_t one, ptrdiff_t other)
{
    const ptrdiff_t w = image->w;
    const double row = (double)(one / w + other / w) / 2 - (double)(pixel / w);
    const double column = (double)(one % w + other % w) / 2 - (double)(pixel % w);
    const float *slope = image->slopes + 2 * pixel;
    return image->fitted[pixel] + slope[0] * column + slope[1] * row;
}

static void measure_pair(const BorderImage *image, const PixelPairs *pairs, ptrdiff_t i, double sign, Border *border,
                         ptrdiff_t place)
{
    const ptrdiff_t one = pairs->inner[i], other = pairs->outer[i];
    const int along_row = pairs->along_row[i];
    const ptrdiff_t inner = inward(image, one, along_row, -pairs->forward[i]);
    const ptrdiff_t outer = inward(image, other, along_row, pairs->forward[i]);
    double jump = at_middle(image, inner, one, other) - at_middle(image, outer, one, other);
    jump = jump < -MOST_JUMP ? -MOST_JUMP : jump > MOST_JUMP ? MOST_JUMP : jump;
    const float *normal = image->normals + 3 * inner, *others = image->normals + 3 * outer;
    const float *at = image->positions + 3 * inner, *to = image->positions + 3 * outer;
    const float *from = image->positions + 3 * one, *beside = image->positions + 3 * other;
    float chord = 0.0f, bend = 0.0f, gap = 0.0f, far = 0.0f;
    for (int k = 0; k < 3; k++) {
        const float turn = normal[k] - others[k], apart = from[k] - beside[k];
        chord += turn * turn;
        bend += turn * (at[k] - to[k]);
        gap += apart * apart;
        far += from[k] * from[k];
    }
    chord = sqrtf(chord);
    border->jump[place] = jump * sign;
    border->turn[place] = bend > 0.0f ? chord : -chord;
    border->size[place] = fabs(jump);
    border->gap[place] = sqrtf(gap);
    border->high[place] = maximum(image->height[one], image->height[other]);
    border->far += sqrtf(far);
    border->steps += (double)pairs->steps[i];
    border->along_row += along_row;
    border->level += fabs(jump) < IN_FRONT;
    border->first_in_front += jump > IN_FRONT;
    border->second_in_front += jump < -IN_FRONT;
    if (image->up) {
        const double *up = image->up;
        const double in = normal[0] * up[0] + normal[1] * up[1] + normal[2] * up[2];
        const double out = others[0] * up[0] + others[1] * up[1] + others[2] * up[2];
        border->rising += (in + out) / 2;
        border->apart += in - out;
    }
}

static float *add_quantiles(double *values, ptrdiff_t count, const double *shares, int number, float *next)
{
    ptrdiff_t from = 0;
    for (int k = 0; k < number; k++) {
        const ptrdiff_t rank = (ptrdiff_t)(shares[k] * (double)(count - 1));
        *next++ = (float)select_number(values, from, count - 1, rank);
        from = rank;
    }
    return next;
}

int describe_borders(const BorderImage *image, const PixelPairs *pairs, const BorderPatches *patches, float *features,
                     int64_t *in_front)
{
    double *values = malloc((size_t)(5 * pairs->count + 1) * sizeof(*values));
    if (!values)
        return OUT_OF_MEMORY;
    int code = 0;
    for (ptrdiff_t i = 0; i < pairs->count && !code; i++) {
        const int64_t size = image->h * image->w;
        if (pairs->inner[i] < 0 || pairs->inner[i] >= size || pairs->outer[i] < 0 || pairs->outer[i] >= size)
            code = OUT_OF_RANGE;
    }
    for (ptrdiff_t k = 0; k < patches->pairs && !code; k++) {
        const int64_t one = patches->first[k], other = patches->second[k];
        const int64_t start = patches->start[k], end = patches->start[k + 1];
        if (one < 0 || one >= patches->count || other < 0 || other >= patches->count || start < 0 || start >= end ||
            end > pairs->count) {
            code = OUT_OF_RANGE;
            break;
        }
        const ptrdiff_t count = (ptrdiff_t)(end - start);
        const int swap = patches->sums[SUMS * one] > patches->sums[SUMS * other]; /* the smaller one counts as first */
        const double sign = swap ? -1.0 : 1.0, outline[2] = {patches->sides[SIDES * one], patches->sides[SIDES * other]};
        const double all = (double)count, nothing = image->up ? 0.0 : NAN;
        Border border = {values, values + count, values + 2 * count, values + 3 * count, values + 4 * count, 0.0, 0.0, 0.0,
                         nothing, nothing, 0, 0, 0};
        for (ptrdiff_t i = 0; i < count; i++)
            measure_pair(image, pairs, (ptrdiff_t)start + i, sign, &border, i);
        const double in_front_of[2] = {(double)border.first_in_front, (double)border.second_in_front};
        float *next = features + AT_BORDER * k;
        next = add_quantiles(border.jump, count, QUANTILE, QUANTILES, next);
        next = add_quantiles(border.turn, count, QUANTILE, QUANTILES, next);
        next = add_quantiles(border.size, count, QUANTILE, QUANTILES, next);
        next = add_quantiles(border.gap, count, LOWER, 2, next);
        next = add_quantiles(border.high, count, ENDS, 2, next);
        *next++ = (float)((double)border.level / all);
        *next++ = (float)(in_front_of[swap] / all);
        *next++ = (float)(in_front_of[!swap] / all);
        *next++ = (float)(border.steps / all);
        *next++ = (float)((double)patches->adjoining[k] / all);
        *next++ = (float)(border.along_row / all);
        *next++ = (float)(border.far / all * all);
        *next++ = (float)(all / (outline[swap] >= 1.0 ? outline[swap] : 1.0));
        *next++ = (float)(all / (outline[!swap] >= 1.0 ? outline[!swap] : 1.0));
        *next++ = (float)(border.rising / all);
        *next++ = (float)(sign * (border.apart / all));
        in_front[k] = border.first_in_front;
        in_front[patches->pairs + k] = border.second_in_front;
    }
    free(values);
    return code;
}
