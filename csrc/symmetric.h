/* The axes of a symmetric 3 × 3 matrix, by Jacobi's rotations: of the upper half 11, 12, 13, 22, 23, 33. */
#ifndef GRASPING_SYMMETRIC_H
#define GRASPING_SYMMETRIC_H

#include <math.h>

enum { SWEEPS = 8 };

/* Let the element (p, q) vanish; `axes` turn along. */
static inline void rotate(double a[3][3], double axes[3][3], int p, int q)
{
    if (a[p][q] == 0.0)
        return;
    const int r = 3 - p - q;
    const double theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    const double size = 1.0 / (fabs(theta) + sqrt(theta * theta + 1.0)), t = theta < 0.0 ? -size : size;
    const double c = 1.0 / sqrt(t * t + 1.0), s = t * c, turned = t * a[p][q], rp = a[r][p], rq = a[r][q];
    a[p][p] -= turned;
    a[q][q] += turned;
    a[p][q] = a[q][p] = 0.0;
    a[r][p] = a[p][r] = c * rp - s * rq;
    a[r][q] = a[q][r] = s * rp + c * rq;
    for (int k = 0; k < 3; k++) {
        const double kp = axes[k][p], kq = axes[k][q];
        axes[k][p] = c * kp - s * kq;
        axes[k][q] = s * kp + c * kq;
    }
}

/* Column k of `axes` is the one along which it is values[k], in no order. */
static inline void find_axes(const double half[6], double values[3], double axes[3][3])
{
    double a[3][3] = {{half[0], half[1], half[2]}, {half[1], half[3], half[4]}, {half[2], half[4], half[5]}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            axes[i][j] = i == j;
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        rotate(a, axes, 0, 1);
        rotate(a, axes, 0, 2);
        rotate(a, axes, 1, 2);
    }
    for (int k = 0; k < 3; k++)
        values[k] = a[k][k];
}

#endif
