/* See patch_measures.measures_of, pair_features.shape_features and group_features.group_features: what sums over the
 * pixels of patches say of each, of pairs and of groups of them. */
#include "segmentation.h"
#include "symmetric.h"

#include <stdlib.h>

enum { QUADRATIC = 6, FITS = 2, SQUARES = 22, CENTRE = 23, NORMAL = 32, AREA = 35, EDGE_OF = 36, OVER = 37 };
#define LITTLE 1e-9
#define TALLEST 0.512
#define PI 3.141592653589793

static const int POWER_C[QUADRATIC] = {0, 1, 0, 2, 1, 0}, POWER_R[QUADRATIC] = {0, 0, 1, 0, 1, 2};
static const int TERMS[FITS] = {3, 6};

/* NumPy's: NaN if either is. */
static inline double at_least(double a, double b) { return (a >= b) | (a != a) ? a : b; }
static inline double at_most(double a, double b) { return (a <= b) | (a != a) ? a : b; }

static inline double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* What a surface is fitted to. */
typedef struct {
    double pixels, moments[QUADRATIC][QUADRATIC], products[QUADRATIC], squares;
} Moments;

/* What is known of a patch, or of a group of them. */
typedef struct {
    Moments of;
    double error[FITS], factors[FITS][QUADRATIC];
    double centre[3], scatter[6], extents[3], normal[3], length, heights[3], outline, sides[4];
} Shape;

/* Where the sum over column^i · row^j stands. */
static int place_of(int i, int j) { return 1 + i * (11 - i) / 2 + j; }

static void read_moments(const double *sums, Moments *of)
{
    of->pixels = sums[0];
    for (int i = 0; i < QUADRATIC; i++) {
        for (int j = 0; j < QUADRATIC; j++)
            of->moments[i][j] = sums[place_of(POWER_C[i] + POWER_C[j], POWER_R[i] + POWER_R[j])];
        of->products[i] = sums[16 + i];
    }
    of->squares = sums[SQUARES];
}

static void unite_moments(const Moments *one, const Moments *other, Moments *of)
{
    of->pixels = one->pixels + other->pixels;
    for (int i = 0; i < QUADRATIC; i++) {
        for (int j = 0; j < QUADRATIC; j++)
            of->moments[i][j] = one->moments[i][j] + other->moments[i][j];
        of->products[i] = one->products[i] + other->products[i];
    }
    of->squares = one->squares + other->squares;
}

/* Fit the surface of so many terms; returns the root mean square error. */
static double fit_quadratic(const Moments *of, int terms, double *factors)
{
    double scale[QUADRATIC], a[QUADRATIC][QUADRATIC], b[QUADRATIC];
    for (int i = 0; i < terms; i++)
        scale[i] = sqrt(at_least(of->moments[i][i], 1e-30));
    for (int i = 0; i < terms; i++) {
        for (int j = 0; j < terms; j++)
            a[i][j] = of->moments[i][j] / (scale[i] * scale[j]) + (i == j ? LITTLE : 0.0);
        b[i] = of->products[i] / scale[i];
    }
    for (int k = 0; k < terms; k++)
        for (int i = k + 1; i < terms; i++) {
            const double share = a[k][i] / a[k][k];
            for (int j = i; j < terms; j++)
                a[i][j] -= share * a[k][j];
            b[i] -= share * b[k];
        }
    for (int i = terms - 1; i >= 0; i--) {
        for (int j = i + 1; j < terms; j++)
            b[i] -= a[i][j] * b[j];
        b[i] /= a[i][i];
    }
    double told = 0.0;
    for (int i = 0; i < terms; i++) {
        factors[i] = b[i] / scale[i];
        told += factors[i] * of->products[i];
    }
    return sqrt(at_least(of->squares - told, 0.0) / at_least(of->pixels, 1.0));
}

/* Standard deviations along the axes, rising. */
static void find_extents(const double scatter[6], double extents[3])
{
    double axes[3][3];
    find_axes(scatter, extents, axes);
    for (int last = 2; last > 0; last--)
        for (int k = 0; k < last; k++)
            if (extents[k + 1] < extents[k]) {
                const double swap = extents[k];
                extents[k] = extents[k + 1];
                extents[k + 1] = swap;
            }
    for (int k = 0; k < 3; k++)
        extents[k] = sqrt(at_least(extents[k], 0.0));
}

/* The heights below which 5, 50 and 95 % lie. */
static void find_heights_of(const double *bins, double heights[3])
{
    static const double shares[3] = {0.05, 0.5, 0.95};
    double total = 0.0;
    for (int k = 0; k < BINS; k++)
        total += bins[k];
    for (int i = 0; i < 3; i++) {
        int below = 0;
        for (double upto = bins[0]; below < BINS && upto < shares[i] * total; upto += below < BINS ? bins[below] : 0.0)
            below++;
        heights[i] = (below + 0.5) * (TALLEST / BINS);
    }
}

static void describe(const double *sums, const double *bins, const double *sides, int with_table, Shape *shape)
{
    static const int one[6] = {0, 0, 0, 1, 1, 2}, other[6] = {0, 1, 2, 1, 2, 2};
    read_moments(sums, &shape->of);
    for (int fit = 0; fit < FITS; fit++)
        shape->error[fit] = fit_quadratic(&shape->of, TERMS[fit], shape->factors[fit]);
    const double pixels = at_least(sums[0], 1.0);
    for (int k = 0; k < 3; k++) {
        shape->centre[k] = sums[CENTRE + k] / pixels;
        shape->normal[k] = sums[NORMAL + k] / pixels;
        shape->heights[k] = NAN;
    }
    for (int k = 0; k < 6; k++)
        shape->scatter[k] = sums[CENTRE + 3 + k] / pixels - shape->centre[one[k]] * shape->centre[other[k]];
    find_extents(shape->scatter, shape->extents);
    shape->length = sqrt(dot(shape->normal, shape->normal));
    if (with_table)
        find_heights_of(bins, shape->heights);
    shape->outline = at_least(sides[0], 1.0);
    for (int k = 0; k < 4; k++)
        shape->sides[k] = sides[1 + k] / shape->outline;
}

/* How well one surface fits two patches, and how far the larger one's lies off the smaller one. */
static float *compare_fits(const Shape *s, const Shape *l, const Moments *united, int fit, float *next)
{
    const int terms = TERMS[fit];
    const double *at = l->factors[fit];
    double factors[QUADRATIC];
    const double error = fit_quadratic(united, terms, factors);
    const double own = s->error[fit] * s->error[fit] * s->of.pixels, its = l->error[fit] * l->error[fit] * l->of.pixels;
    double told = 0.0, expected = 0.0, mean = 0.0;
    for (int i = 0; i < terms; i++) {
        double along = 0.0;
        for (int j = 0; j < terms; j++)
            along += s->of.moments[i][j] * at[j];
        told += at[i] * s->of.products[i];
        expected += at[i] * along;
        mean += at[i] * s->of.moments[i][0];
    }
    const double square = s->of.squares - 2 * told + expected;
    *next++ = (float)s->error[fit];
    *next++ = (float)l->error[fit];
    *next++ = (float)error;
    *next++ = (float)(error - sqrt((own + its) / united->pixels));
    *next++ = (float)at_most(sqrt(at_least(square, 0.0) / s->of.pixels), 1.0);
    *next++ = (float)at_most(at_least((s->of.products[0] - mean) / s->of.pixels, -1.0), 1.0);
    return next;
}

static float *compare_heights(const double *s, const double *l, float *next)
{
    for (int k = 0; k < 3; k++) {
        *next++ = (float)s[k];
        *next++ = (float)l[k];
    }
    *next++ = (float)(s[2] - l[2]);
    *next++ = (float)(s[0] - l[0]);
    *next++ = (float)(s[0] - l[2]);
    *next++ = (float)(l[0] - s[2]);
    return next;
}

/* The smaller one first. */
static void compare(const Shape *s, const Shape *l, const double *sums_s, const double *sums_l, const double *up,
                    float *next)
{
    Moments united;
    unite_moments(&s->of, &l->of, &united);
    for (int fit = 0; fit < FITS; fit++)
        next = compare_fits(s, l, &united, fit, next);
    double towards_s[3], towards_l[3], turn[3], between[3], scatter[6], extents[3];
    for (int k = 0; k < 3; k++) {
        towards_s[k] = s->normal[k] / at_least(s->length, 1e-9);
        towards_l[k] = l->normal[k] / at_least(l->length, 1e-9);
        turn[k] = towards_s[k] - towards_l[k];
        between[k] = s->centre[k] - l->centre[k];
    }
    *next++ = (float)sqrt(dot(turn, turn));
    *next++ = (float)(1 - s->length);
    *next++ = (float)(1 - l->length);
    *next++ = up ? (float)dot(towards_s, up) : NAN;
    *next++ = up ? (float)dot(towards_l, up) : NAN;
    next = compare_heights(s->heights, l->heights, next);
    for (int k = 0; k < 4; k++) {
        *next++ = (float)s->sides[k];
        *next++ = (float)l->sides[k];
    }
    *next++ = (float)(sums_s[EDGE_OF] / at_least(s->of.pixels, 1.0));
    *next++ = (float)(sums_l[EDGE_OF] / at_least(l->of.pixels, 1.0));
    *next++ = (float)sums_s[AREA];
    *next++ = (float)sums_l[AREA];
    const double distance = at_least(sqrt(dot(between, between)), 1e-6), rise = up ? dot(between, up) : NAN;
    *next++ = (float)(s->of.pixels / l->of.pixels);
    *next++ = (float)s->of.pixels;
    *next++ = (float)distance;
    *next++ = (float)(rise / distance);
    *next++ = (float)sqrt(at_least(distance * distance - rise * rise, 0.0));
    const double share = s->of.pixels * l->of.pixels / (united.pixels * united.pixels);
    for (int i = 0, k = 0; i < 3; i++)
        for (int j = i; j < 3; j++, k++)
            scatter[k] = s->scatter[k] * (s->of.pixels / united.pixels) + l->scatter[k] * (l->of.pixels / united.pixels) +
                         share * between[i] * between[j];
    find_extents(scatter, extents);
    for (int k = 0; k < 3; k++) {
        *next++ = (float)s->extents[k];
        *next++ = (float)l->extents[k];
        *next++ = (float)extents[k];
    }
    *next++ = (float)(dot(towards_s, between) / distance);
    *next++ = (float)(-dot(towards_l, between) / distance);
}

int describe_pairs(const PatchSums *patches, const Pairs *pairs, const double *up, float *features)
{
    Shape *shapes = malloc(((size_t)patches->count + 1) * sizeof(*shapes));
    if (!shapes)
        return OUT_OF_MEMORY;
    for (ptrdiff_t i = 0; i < patches->count; i++)
        describe(patches->sums + SUMS * i, patches->bins + BINS * i, patches->sides + SIDES * i, patches->with_table,
                 &shapes[i]);
    int code = 0;
    for (ptrdiff_t i = 0; i < pairs->count; i++) {
        int64_t s = pairs->first[i], l = pairs->second[i];
        if (s < 0 || l < 0 || s >= patches->count || l >= patches->count) {
            code = OUT_OF_RANGE;
            break;
        }
        if (shapes[s].of.pixels > shapes[l].of.pixels) {
            const int64_t swap = s;
            s = l;
            l = swap;
        }
        float *row = features + OF_BOTH * i;
        row[0] = pairs->behind_one[i];
        row[1] = pairs->at_hole[i];
        compare(&shapes[s], &shapes[l], patches->sums + SUMS * s, patches->sums + SUMS * l, up, row + 2);
    }
    free(shapes);
    return code;
}

void describe_groups(const PatchSums *groups, const double *up, float *features)
{
    for (ptrdiff_t i = 0; i < groups->count; i++) {
        const double *sums = groups->sums + SUMS * i, pixels = at_least(sums[0], 1.0);
        float *next = features + OF_GROUP * i;
        Shape shape;
        describe(sums, groups->bins + BINS * i, groups->sides + SIDES * i, groups->with_table, &shape);
        *next++ = (float)sums[0];
        *next++ = (float)sums[AREA];
        for (int k = 0; k < 3; k++)
            *next++ = (float)shape.heights[k];
        for (int k = 0; k < 4; k++)
            *next++ = (float)shape.sides[k];
        *next++ = (float)(sums[EDGE_OF] / pixels);
        *next++ = (float)(shape.outline / sqrt(pixels));
        *next++ = (float)shape.error[0];
        *next++ = (float)shape.error[1];
        *next++ = (float)(1 - shape.length);
        *next++ = up ? (float)(dot(shape.normal, up) / at_least(shape.length, 1e-9)) : NAN;
        for (int k = 0; k < 3; k++)
            *next++ = (float)shape.extents[k];
        for (int k = 0; k < 2; k++)
            *next++ = groups->with_table ? (float)(sums[OVER + k] / pixels) : NAN;
        *next++ = (float)(sums[AREA] / at_least(4 * PI * shape.extents[1] * shape.extents[2], 1e-9));
    }
}
