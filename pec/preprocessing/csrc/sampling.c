/* Farthest point sampling, as in preprocess.farthest_point_sampling. */
#include "preprocessing.h"

/* squared: the least squared distance of each point to the chosen ones, which point `index` now joins; 0 in the padding.
 * Returns the point that is farthest then, of equally far ones the first. */
WIDE static ptrdiff_t join(const float *restrict x, const float *restrict y, const float *restrict z,
                           float *restrict squared, ptrdiff_t padded, ptrdiff_t index)
{
    const float px = x[index], py = y[index], pz = z[index];
    float farthest = -1.0f;
    ptrdiff_t where = 0;
    for (ptrdiff_t block = 0; block < padded; block += BLOCK) {
        float most[LANES] = {0.0f};
        for (int i = 0; i < BLOCK; i += LANES)
            for (int lane = 0; lane < LANES; lane++) {
                const ptrdiff_t j = block + i + lane;
                const float dx = x[j] - px, dy = y[j] - py, dz = z[j] - pz;
                const float distance = dx * dx + dy * dy + dz * dz;
                const float least = distance < squared[j] ? distance : squared[j];
                squared[j] = least;
                most[lane] = least > most[lane] ? least : most[lane];
            }
        for (int half = LANES / 2; half; half /= 2)
            for (int lane = 0; lane < half; lane++)
                most[lane] = most[lane + half] > most[lane] ? most[lane + half] : most[lane];
        if (most[0] > farthest) {
            farthest = most[0];
            where = block;
        }
    }
    while (squared[where] != farthest)
        where++;
    return where;
}

static double coordinate(const void *cloud, int wide, ptrdiff_t i)
{
    return wide ? ((const double *)cloud)[i] : (double)((const float *)cloud)[i];
}

int sample_cloud(const void *cloud, int wide, ptrdiff_t count, ptrdiff_t n, ptrdiff_t start, float *out)
{
    double mean[3] = {0.0, 0.0, 0.0};
    for (ptrdiff_t i = 0; i < count; i++)
        for (int axis = 0; axis < 3; axis++)
            mean[axis] += coordinate(cloud, wide, 3 * i + axis);
    for (int axis = 0; axis < 3; axis++)
        mean[axis] /= (double)count;
    Rows rows;
    if (!allocate(&rows, count))
        return -1;
    float *squared = calloc((size_t)rows.padded, sizeof(float));
    int ordinary = 1;
    for (int axis = 0; axis < 3; axis++) {
        float *row = rows.x + axis * rows.padded;
        for (ptrdiff_t i = 0; i < count; i++) {
            row[i] = (float)(coordinate(cloud, wide, 3 * i + axis) - mean[axis]);
            ordinary &= fabsf(row[i]) < FARTHEST; /* false of what is not a number, too */
        }
    }
    if (squared && ordinary) {
        if (start < 0) {
            float greatest = -1.0f;
            for (ptrdiff_t i = 0; i < count; i++) {
                const float length = squared_length(rows.x[i], rows.y[i], rows.z[i]);
                if (length > greatest) {
                    greatest = length;
                    start = i;
                }
            }
        }
        for (ptrdiff_t i = 0; i < count; i++)
            squared[i] = INFINITY;
        for (ptrdiff_t k = 0; k < n; k++) {
            out[3 * k] = rows.x[start];
            out[3 * k + 1] = rows.y[start];
            out[3 * k + 2] = rows.z[start];
            if (k + 1 < n)
                start = join(rows.x, rows.y, rows.z, squared, rows.padded, start);
        }
    }
    const int code = squared ? ordinary : -1;
    free(rows.x);
    free(squared);
    return code;
}
