/* Repeats alignment.partners and alignment.align. */
#include "pose.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

int check_grid(const Grid *grid)
{
    const int32_t most = grid->count < INT32_MAX ? (int32_t)grid->count : INT32_MAX;
    int beyond = 0; /* without a way out of the loop it is vectorised */
    for (ptrdiff_t i = 0; i < SIDES * grid->x * grid->y * grid->z; i++)
        beyond |= grid->nearest[i] >= most;
    return beyond ? OUT_OF_RANGE : 0;
}

ptrdiff_t find_partner(const Grid *grid, const double *point, const double *normal, const double *T, double *place)
{
    const double x = point[0] - T[3], y = point[1] - T[7], z = point[2] - T[11];
    double facing[3];
    for (int i = 0; i < 3; i++) {
        place[i] = T[i] * x + T[4 + i] * y + T[8 + i] * z;
        facing[i] = T[i] * normal[0] + T[4 + i] * normal[1] + T[8 + i] * normal[2];
    }
    const double a = floor((place[0] - grid->corner[0]) / grid->cell), b = floor((place[1] - grid->corner[1]) / grid->cell),
                 c = floor((place[2] - grid->corner[2]) / grid->cell);
    /* Written so that NaN is outside. */
    if (!(a >= 0 && a < (double)grid->x && b >= 0 && b < (double)grid->y && c >= 0 && c < (double)grid->z))
        return -1;
    const int32_t *nearest =
        grid->nearest + SIDES * (((ptrdiff_t)a * grid->y + (ptrdiff_t)b) * grid->z + (ptrdiff_t)c);
    double best = INFINITY;
    ptrdiff_t partner = -1;
    for (int side = 0; side < SIDES; side++, nearest++) {
        if (*nearest < 0)
            continue;
        const double *q = grid->points + 3 * (ptrdiff_t)*nearest, *n = grid->normals + 3 * (ptrdiff_t)*nearest;
        const double dx = place[0] - q[0], dy = place[1] - q[1], dz = place[2] - q[2];
        const double squared = dx * dx + dy * dy + dz * dz;
        if (facing[0] * n[0] + facing[1] * n[1] + facing[2] * n[2] > SAME_SIDE && squared < best) {
            best = squared;
            partner = *nearest;
        }
    }
    return partner;
}

/* Which of the six a shift along x, y, z depends on. */
static const int TURNED[3][3] = {{1, 2, 3}, {0, 2, 4}, {0, 1, 5}};

/* x of A x = −b, of whose A the lower half is read and overwritten. */
static void solve(double A[6][6], const double b[6], double x[6])
{
    double trace = A[0][0];
    for (int i = 1; i < 6; i++)
        trace = trace + A[i][i];
    for (int i = 0; i < 6; i++) {
        A[i][i] = A[i][i] + (DAMPED * trace + 1e-12);
        x[i] = -b[i];
    }
    for (int j = 0; j < 6; j++) {
        for (int k = 0; k < j; k++)
            A[j][j] = A[j][j] - A[j][k] * A[j][k];
        A[j][j] = sqrt(A[j][j] > 1e-18 ? A[j][j] : 1e-18);
        for (int i = j + 1; i < 6; i++) {
            for (int k = 0; k < j; k++)
                A[i][j] = A[i][j] - A[i][k] * A[j][k];
            A[i][j] = A[i][j] / A[j][j];
        }
    }
    for (int i = 0; i < 6; i++) {
        for (int k = 0; k < i; k++)
            x[i] = x[i] - A[i][k] * x[k];
        x[i] = x[i] / A[i][i];
    }
    for (int i = 5; i >= 0; i--) {
        for (int k = i + 1; k < 6; k++)
            x[i] = x[i] - A[k][i] * x[k];
        x[i] = x[i] / A[i][i];
    }
}

static void move_back(double *T, const double step[6], const double *centre)
{
    const double a = 0.5 * step[0], b = 0.5 * step[1], c = 0.5 * step[2], d = 1.0 + a * a + b * b + c * c;
    const double R[3][3] = {
        {(1.0 + a * a - b * b - c * c) / d, 2.0 * (a * b - c) / d, 2.0 * (a * c + b) / d},
        {2.0 * (a * b + c) / d, (1.0 - a * a + b * b - c * c) / d, 2.0 * (b * c - a) / d},
        {2.0 * (a * c - b) / d, 2.0 * (b * c + a) / d, (1.0 - a * a - b * b + c * c) / d},
    };
    const double at[3] = {centre[0] + step[3], centre[1] + step[4], centre[2] + step[5]};
    double shift[3], out[12];
    for (int i = 0; i < 3; i++)
        shift[i] = centre[i] - (R[0][i] * at[0] + R[1][i] * at[1] + R[2][i] * at[2]);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            out[4 * i + j] = T[4 * i] * R[j][0] + T[4 * i + 1] * R[j][1] + T[4 * i + 2] * R[j][2];
        out[4 * i + 3] = T[4 * i] * shift[0] + T[4 * i + 1] * shift[1] + T[4 * i + 2] * shift[2] + T[4 * i + 3];
    }
    memcpy(T, out, sizeof(out));
}

void align_poses(const Grid *grid, const double *points, const double *normals, ptrdiff_t count, const double *gates,
                 ptrdiff_t steps, double *T, ptrdiff_t poses)
{
    for (ptrdiff_t pose = 0; pose < poses; pose++, T += 16) {
        for (ptrdiff_t number = 0; number < steps; number++) {
            const double gate = gates[number];
            /* The rows' sums one after the other, as the reference adds them up. */
            double A[4][6][6] = {{{0.0}}}, b[4][6] = {{0.0}};
            for (ptrdiff_t k = 0; k < count; k++) {
                double place[3];
                const ptrdiff_t partner = find_partner(grid, points + 3 * k, normals + 3 * k, T, place);
                if (partner < 0)
                    continue;
                const double *q = grid->points + 3 * partner, *n = grid->normals + 3 * partner;
                const double e[3] = {place[0] - q[0], place[1] - q[1], place[2] - q[2]};
                const double squared = e[0] * e[0] + e[1] * e[1] + e[2] * e[2];
                const double near = 1.0 - squared / (gate * gate);
                if (!(near > 0.0))
                    continue;
                const double weight = near * near, weak = weight * ALONG;
                const double arm[3] = {place[0] - grid->centre[0], place[1] - grid->centre[1], place[2] - grid->centre[2]};
                const double along = e[0] * n[0] + e[1] * n[1] + e[2] * n[2];
                const double J[6] = {arm[1] * n[2] - arm[2] * n[1], arm[2] * n[0] - arm[0] * n[2],
                                     arm[0] * n[1] - arm[1] * n[0], n[0], n[1], n[2]};
                for (int i = 0; i < 6; i++) {
                    const double weighted = weight * J[i];
                    b[0][i] += weighted * along;
                    for (int j = 0; j <= i; j++)
                        A[0][i][j] += weighted * J[j];
                }
                /* The rows of the place itself: of each Jacobian all but three numbers are zero. */
                const double K[3][3] = {{arm[2], -arm[1], 1.0}, {-arm[2], arm[0], 1.0}, {arm[1], -arm[0], 1.0}};
                for (int r = 0; r < 3; r++) {
                    for (int i = 0; i < 3; i++) {
                        const double weighted = weak * K[r][i];
                        const int row = TURNED[r][i];
                        b[1 + r][row] += weighted * e[r];
                        for (int j = 0; j <= i; j++)
                            A[1 + r][row][TURNED[r][j]] += weighted * K[r][j];
                    }
                }
            }
            double sum[6][6], right[6], step[6];
            for (int i = 0; i < 6; i++) {
                right[i] = 0.0 + b[0][i] + b[1][i] + b[2][i] + b[3][i];
                for (int j = 0; j <= i; j++)
                    sum[i][j] = 0.0 + A[0][i][j] + A[1][i][j] + A[2][i][j] + A[3][i][j];
            }
            solve(sum, right, step);
            move_back(T, step, grid->centre);
            int rests = gate == gates[steps - 1];
            for (int i = 0; i < 6; i++)
                rests = rests && fabs(step[i]) < RESTS;
            if (rests)
                break;
        }
    }
}
