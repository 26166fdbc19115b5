/* Orders of one cloud: the published grouping, and fixed positions that each take their nearest point. */
#include "preprocessing.h"

#include <string.h>

void group_points(const float *points, ptrdiff_t n, ptrdiff_t size, int64_t *order, float *spare, char *taken,
                  int64_t *sorted)
{
    for (ptrdiff_t group = 0, seed = 0; group < n; group += size) {
        while (taken[seed])
            seed++;
        const float *at = points + 3 * seed;
        ptrdiff_t found = 0;
        int64_t *members = order + group;
        for (ptrdiff_t i = seed; i < n; i++) {
            if (taken[i])
                continue;
            const float *point = points + 3 * i;
            const float distance = squared_length(point[0] - at[0], point[1] - at[1], point[2] - at[2]);
            if (found == size && !(distance < spare[size - 1]))
                continue;
            ptrdiff_t place = found < size ? found++ : size - 1;
            for (; place > 0 && spare[place - 1] > distance; place--) {
                spare[place] = spare[place - 1];
                members[place] = members[place - 1];
            }
            spare[place] = distance;
            members[place] = i;
        }
        for (ptrdiff_t i = 0; i < size; i++)
            taken[members[i]] = 1;
    }
    const ptrdiff_t groups = n / size;
    for (ptrdiff_t group = 0; group < groups; group++) { /* spare, sorted: distances and numbers of groups, sorted */
        float centroid[3] = {0.0f, 0.0f, 0.0f};
        for (ptrdiff_t i = 0; i < size; i++)
            for (int axis = 0; axis < 3; axis++)
                centroid[axis] += points[3 * order[group * size + i] + axis];
        for (int axis = 0; axis < 3; axis++)
            centroid[axis] /= (float)size;
        const float distance = squared_length(centroid[0], centroid[1], centroid[2]);
        ptrdiff_t place = group;
        for (; place > 0 && spare[place - 1] > distance; place--) {
            spare[place] = spare[place - 1];
            sorted[place] = sorted[place - 1];
        }
        spare[place] = distance;
        sorted[place] = group;
    }
    for (ptrdiff_t place = 0; place < groups; place++) /* behind the numbers of the groups, which are no more than n */
        memcpy(sorted + n + place * size, order + sorted[place] * size, (size_t)size * sizeof(*order));
    memcpy(order, sorted + n, (size_t)n * sizeof(*order));
}

void principal_axes(double a[3][3], double axes[3][3])
{
    double v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int sweep = 0; sweep < 50; sweep++) {
        if (a[0][1] == 0.0 && a[0][2] == 0.0 && a[1][2] == 0.0)
            break;
        for (int p = 0; p < 2; p++)
            for (int q = p + 1; q < 3; q++) {
                const double small = fabs(a[p][q]);
                if (fabs(a[p][p]) + small == fabs(a[p][p]) && fabs(a[q][q]) + small == fabs(a[q][q])) {
                    a[p][q] = a[q][p] = 0.0;
                    continue;
                }
                const double theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                const double t = (theta < 0.0 ? -1.0 : 1.0) / (fabs(theta) + sqrt(theta * theta + 1.0));
                const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
                for (int k = 0; k < 3; k++) {
                    const double kp = a[k][p], kq = a[k][q];
                    a[k][p] = c * kp - s * kq;
                    a[k][q] = s * kp + c * kq;
                }
                for (int k = 0; k < 3; k++) {
                    const double pk = a[p][k], qk = a[q][k], vp = v[k][p], vq = v[k][q];
                    a[p][k] = c * pk - s * qk;
                    a[q][k] = s * pk + c * qk;
                    v[k][p] = c * vp - s * vq;
                    v[k][q] = s * vp + c * vq;
                }
                a[p][q] = a[q][p] = 0.0;
            }
    }
    int first = 0, second;
    for (int i = 1; i < 3; i++)
        first = a[i][i] > a[first][first] ? i : first;
    second = first == 0 ? 1 : 0;
    for (int i = 0; i < 3; i++)
        second = i != first && a[i][i] > a[second][second] ? i : second;
    for (int k = 0; k < 3; k++) {
        axes[k][0] = v[k][first];
        axes[k][1] = v[k][second];
    }
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        axes[k][2] = axes[i][0] * axes[j][1] - axes[j][0] * axes[i][1];
    }
}

/* Centres the points and turns them to their principal axes; the signs of those are left open. */
static void turn_to_axes(Rows *rows)
{
    float *row[3] = {rows->x, rows->y, rows->z};
    const double n = (double)rows->count;
    double mean[3] = {0.0, 0.0, 0.0}, covariance[3][3], axes[3][3];
    for (int axis = 0; axis < 3; axis++) {
        for (ptrdiff_t i = 0; i < rows->count; i++)
            mean[axis] += row[axis][i];
        mean[axis] /= n;
    }
    for (int one = 0; one < 3; one++)
        for (int other = 0; other <= one; other++) {
            double sum = 0.0;
            for (ptrdiff_t i = 0; i < rows->count; i++)
                sum += (row[one][i] - mean[one]) * (row[other][i] - mean[other]);
            covariance[one][other] = covariance[other][one] = sum / n;
        }
    principal_axes(covariance, axes);
    for (ptrdiff_t i = 0; i < rows->count; i++) {
        const double x = row[0][i] - mean[0], y = row[1][i] - mean[1], z = row[2][i] - mean[2];
        for (int axis = 0; axis < 3; axis++)
            row[axis][i] = (float)(x * axes[0][axis] + y * axes[1][axis] + z * axes[2][axis]);
    }
}

/* The point nearest to this position, of equally near ones the first. The padding is too far away to be one. */
WIDE static ptrdiff_t nearest(const float *restrict x, const float *restrict y, const float *restrict z, ptrdiff_t padded,
                              float px, float py, float pz)
{
    float least = INFINITY;
    ptrdiff_t where = 0;
    for (ptrdiff_t block = 0; block < padded; block += BLOCK) {
        float nearer[LANES];
        for (int lane = 0; lane < LANES; lane++)
            nearer[lane] = INFINITY;
        for (int i = 0; i < BLOCK; i += LANES)
            for (int lane = 0; lane < LANES; lane++) {
                const ptrdiff_t j = block + i + lane;
                const float dx = x[j] - px, dy = y[j] - py, dz = z[j] - pz;
                const float distance = dx * dx + dy * dy + dz * dz;
                nearer[lane] = distance < nearer[lane] ? distance : nearer[lane];
            }
        for (int half = LANES / 2; half; half /= 2)
            for (int lane = 0; lane < half; lane++)
                nearer[lane] = nearer[lane + half] < nearer[lane] ? nearer[lane + half] : nearer[lane];
        if (nearer[0] < least) {
            least = nearer[0];
            where = block;
        }
    }
    while (where + 1 < padded && squared_length(x[where] - px, y[where] - py, z[where] - pz) != least)
        where++;
    return where;
}

int arrange_cloud(const float *candidates, ptrdiff_t count, const float *anchors, ptrdiff_t n, const float *signs,
                  ptrdiff_t views, int principal, int each_axis, float *out)
{
    Rows posed, scaled;
    if (!allocate(&posed, count))
        return 0;
    if (!allocate(&scaled, count)) {
        free(posed.x);
        return 0;
    }
    float *row[3] = {posed.x, posed.y, posed.z}, *unit[3] = {scaled.x, scaled.y, scaled.z};
    for (ptrdiff_t i = 0; i < count; i++)
        for (int axis = 0; axis < 3; axis++)
            row[axis][i] = candidates[3 * i + axis];
    if (principal)
        turn_to_axes(&posed);
    double variance[3] = {0.0, 0.0, 0.0};
    for (int axis = 0; axis < 3; axis++) {
        for (ptrdiff_t i = 0; i < count; i++)
            variance[axis] += (double)row[axis][i] * row[axis][i];
        variance[axis] /= (double)count;
    }
    for (int axis = 0; axis < 3; axis++) {
        const double spread = sqrt(each_axis ? variance[axis] : variance[0] + variance[1] + variance[2]);
        const float divisor = spread > 1e-9 ? (float)spread : 1e-9f;
        for (ptrdiff_t i = 0; i < count; i++)
            unit[axis][i] = row[axis][i] / divisor;
        for (ptrdiff_t i = count; i < scaled.padded; i++)
            unit[axis][i] = FARTHEST;
    }
    for (ptrdiff_t view = 0; view < views; view++) {
        /* A flipped cloud is as far from the positions as the cloud is from flipped positions. */
        const float *sign = signs + 3 * view;
        for (ptrdiff_t i = 0; i < n; i++) {
            const float *at = anchors + 3 * i;
            const ptrdiff_t j =
                nearest(scaled.x, scaled.y, scaled.z, scaled.padded, sign[0] * at[0], sign[1] * at[1], sign[2] * at[2]);
            for (int axis = 0; axis < 3; axis++)
                *out++ = sign[axis] * row[axis][j];
        }
    }
    free(posed.x);
    free(scaled.x);
    return 1;
}
