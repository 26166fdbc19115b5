/* See surface_patches.edges: how much the planes to both sides of a pixel fold or jump, a run of pixels at a time. */
#include "segmentation.h"

#include <math.h>
#include <string.h>

enum { STEP = 2, DIRECTIONS = 4 };
static const int DOWN[DIRECTIONS] = {0, 1, 1, 1}, ACROSS[DIRECTIONS] = {1, 0, 1, -1};
#define CONVEX 0.9f
#define CONCAVE 1.3f
#define JUMP 0.016
#define BROKEN 1.5f
#define CONTINUOUS 0.03f

/* The surface at a run of pixels. */
typedef struct {
    const float *fitted, *slopes, *normals, *positions;
} Surface;

static inline Surface from_pixel(const Surface *whole, ptrdiff_t pixel)
{
    const Surface part = {whole->fitted + pixel, whole->slopes + 2 * pixel, whole->normals + 3 * pixel,
                          whole->positions + 3 * pixel};
    return part;
}

/* Raise `edge` of `count` pixels between `one` and `other`, `here` columns and `there` rows away to either side. */
static void compare(Surface one, Surface other, float here, float there, ptrdiff_t count, float *restrict edge)
{
    const float jumps = (float)(1.0 / JUMP);
    for (ptrdiff_t i = 0; i < count; i++) {
        const int both = (one.fitted[i] > 0.0f) & (other.fitted[i] > 0.0f);
        const float from_one = one.fitted[i] + one.slopes[2 * i] * here + one.slopes[2 * i + 1] * there;
        const float from_other = other.fitted[i] - other.slopes[2 * i] * here - other.slopes[2 * i + 1] * there;
        const float jump = fabsf(from_one - from_other) * jumps;
        const float turn_x = one.normals[3 * i] - other.normals[3 * i];
        const float turn_y = one.normals[3 * i + 1] - other.normals[3 * i + 1];
        const float turn_z = one.normals[3 * i + 2] - other.normals[3 * i + 2];
        const float apart_x = one.positions[3 * i] - other.positions[3 * i];
        const float apart_y = one.positions[3 * i + 1] - other.positions[3 * i + 1];
        const float apart_z = one.positions[3 * i + 2] - other.positions[3 * i + 2];
        const float chord = sqrtf(turn_x * turn_x + turn_y * turn_y + turn_z * turn_z);
        const float bend = turn_x * apart_x + turn_y * apart_y + turn_z * apart_z;
        const float fold = (bend > 0.0f ? CONVEX : CONCAVE) * chord;
        const float found = maximum(fold, jump);
        edge[i] = maximum(edge[i], both ? found : 0.0f);
    }
}

/* Raise `edge` of `count` pixels beside ones that lie elsewhere, `step` pixels away. */
static void compare_neighbours(const float *fitted, ptrdiff_t step, ptrdiff_t count, float *restrict edge)
{
    for (ptrdiff_t i = 0; i < count; i++) {
        const float other = fitted[i + step];
        const int broken = (other > 0.0f) & (fabsf(other - fitted[i]) >= CONTINUOUS);
        edge[i] = maximum(edge[i], broken ? BROKEN : 0.0f);
    }
}

int find_edges(const float *fitted, const float *slopes, const float *normals, const float *positions, ptrdiff_t h,
               ptrdiff_t w, const int64_t *asked, ptrdiff_t count, float *edge)
{
    const Surface whole = {fitted, slopes, normals, positions};
    ptrdiff_t length;
    for (ptrdiff_t i = 0; i < count; i += length) {
        const int64_t first = asked[i];
        if (first < 0 || first >= h * w)
            return OUT_OF_RANGE;
        const ptrdiff_t row = first / w, start = row * w, column = first - start;
        for (length = 1; i + length < count && column + length < w && asked[i + length] == first + length; length++)
            continue;
        memset(edge + first, 0, (size_t)length * sizeof(*edge));
        for (int k = 0; k < DIRECTIONS; k++) {
            const ptrdiff_t down = STEP * DOWN[k], across = STEP * ACROSS[k], reach = across < 0 ? -across : across;
            const ptrdiff_t from = column > reach ? column : reach;
            const ptrdiff_t to = column + length < w - reach ? column + length : w - reach;
            if (row < down || row >= h - down || from >= to)
                continue;
            const ptrdiff_t step = down * w + across;
            compare(from_pixel(&whole, start + from - step), from_pixel(&whole, start + from + step), (float)across,
                    (float)down, to - from, edge + start + from);
        }
        for (int side = -1; side <= 1; side += 2) {
            if (row + side >= 0 && row + side < h)
                compare_neighbours(fitted + first, side * w, length, edge + first);
            const ptrdiff_t from = column + side < 0 ? 1 : 0, to = column + length - 1 + side >= w ? length - 1 : length;
            if (from < to)
                compare_neighbours(fitted + first + from, side, to - from, edge + first + from);
        }
    }
    return 0;
}
