/* Repeats sight_check.look. */
#include "pose.h"

#include <math.h>
#include <stdlib.h>

typedef struct {
    double u, v, z, cosine;
    ptrdiff_t cell;
} Facing;

static void judge(const View *view, const Facing *p, double tolerance, double *sums)
{
    const double slack = tolerance / (p->cosine > STEEP ? p->cosine : STEEP), z = p->z;
    const double x = floor((p->u - view->left) / view->pitch), y = floor((p->v - view->top) / view->pitch);
    const ptrdiff_t h = view->h, w = view->w;
    const ptrdiff_t column = !(x >= -2) ? -2 : x > (double)(w + 1) ? w + 1 : (ptrdiff_t)x;
    const ptrdiff_t row = !(y >= -2) ? -2 : y > (double)(h + 1) ? h + 1 : (ptrdiff_t)y;
    int seen = 0, nearer = 0, farther = 0;
    for (ptrdiff_t r = row - 1; r <= row + 1; r++)
        for (ptrdiff_t c = column - 1; c <= column + 1; c++) {
            if (r < 0 || r >= h || c < 0 || c >= w)
                continue;
            const double near = view->near[r * w + c], far = view->far[r * w + c];
            if (!(far > 0.0))
                continue;
            seen |= near <= z + slack && far >= z - slack;
            nearer |= near < z - slack;
            if (r == row && c == column)
                farther = near > z + slack;
        }
    sums[seen ? 0 : nearer ? 2 : farther ? 1 : 3] += p->cosine;
}

int look_at_poses(const View *view, const double *points, const double *normals, ptrdiff_t count, const double *T,
                  ptrdiff_t poses, double coarse, double tolerance, double *sums)
{
    Facing *facing = malloc((size_t)count * sizeof(*facing) + 1);
    double *first = malloc(BUFFER * BUFFER * sizeof(*first));
    if (!facing || !first) {
        free(facing);
        free(first);
        return OUT_OF_MEMORY;
    }
    for (ptrdiff_t pose = 0; pose < poses; pose++, T += 16, sums += 4) {
        ptrdiff_t faces = 0;
        double depth = 0.0, left = INFINITY, top = INFINITY;
        for (ptrdiff_t k = 0; k < count; k++) {
            const double *p = points + 3 * k, *n = normals + 3 * k;
            const double x = T[0] * p[0] + T[1] * p[1] + T[2] * p[2] + T[3];
            const double y = T[4] * p[0] + T[5] * p[1] + T[6] * p[2] + T[7];
            const double z = T[8] * p[0] + T[9] * p[1] + T[10] * p[2] + T[11];
            const double a = T[0] * n[0] + T[1] * n[1] + T[2] * n[2];
            const double b = T[4] * n[0] + T[5] * n[1] + T[6] * n[2];
            const double c = T[8] * n[0] + T[9] * n[1] + T[10] * n[2];
            const double far = sqrt(x * x + y * y + z * z);
            const double cosine = -(x * a + y * b + z * c) / (far > NEAREST ? far : NEAREST);
            depth += z;
            if (!(cosine > GRAZING && z > NEAREST))
                continue;
            const Facing one = {x / z, y / z, z, cosine, 0};
            left = one.u < left ? one.u : left;
            top = one.v < top ? one.v : top;
            facing[faces++] = one;
        }
        const double middle = depth / (double)count;
        if (!faces || !(middle > NEAREST))
            continue;
        const double pixel = coarse / middle;
        for (ptrdiff_t k = 0; k < BUFFER * BUFFER; k++)
            first[k] = INFINITY;
        for (ptrdiff_t k = 0; k < faces; k++) {
            const double x = floor((facing[k].u - left) / pixel), y = floor((facing[k].v - top) / pixel);
            const ptrdiff_t column = x < BUFFER - 1 ? (ptrdiff_t)x : BUFFER - 1;
            const ptrdiff_t row = y < BUFFER - 1 ? (ptrdiff_t)y : BUFFER - 1;
            facing[k].cell = row * BUFFER + column;
            if (facing[k].z < first[facing[k].cell])
                first[facing[k].cell] = facing[k].z;
        }
        for (ptrdiff_t k = 0; k < faces; k++)
            if (facing[k].z <= first[facing[k].cell] + BEHIND * coarse)
                judge(view, &facing[k], tolerance, sums);
    }
    free(facing);
    free(first);
    return 0;
}
