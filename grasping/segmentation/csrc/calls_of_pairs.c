/* The Python side of border_features.c and shapes.c. */
#include "module.h"

static const double *upward(Arrays *arrays, PyObject *up) { return items(arrays, up, "up", "d", 3, 0, 0, 0); }

/* Sums of patches, of which the first of the three says how many there are. */
static int sums_of(Arrays *arrays, PyObject *sums, PyObject *bins, PyObject *sides, PatchSums *patches)
{
    const Py_buffer *added = array_argument(arrays, sums, "sums", "d", 2, 1, SUMS, 0);
    if (!added)
        return 0;
    patches->sums = added->buf;
    patches->count = added->shape[0];
    return (patches->bins = items(arrays, bins, "bins", "d", patches->count, BINS, 0, 0)) &&
           (patches->sides = items(arrays, sides, "sides", "d", patches->count, SIDES, 0, 0));
}

PyObject *call_describe_pairs(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *sums, *bins, *sides, *first, *second, *behind_one, *at_hole, *up, *features, *answer = NULL;
    PatchSums patches;
    Pairs pairs;
    if (!PyArg_ParseTuple(arguments, "OOOpOOOOOO", &sums, &bins, &sides, &patches.with_table, &first, &second, &behind_one,
                          &at_hole, &up, &features))
        return NULL;
    Arrays arrays = {.count = 0};
    const double *along = NULL;
    float *out;
    if (sums_of(&arrays, sums, bins, sides, &patches) &&
        (pairs.first = list(&arrays, first, "first", INT64, &pairs.count)) &&
        (pairs.second = items(&arrays, second, "second", INT64, pairs.count, 0, 0, 0)) &&
        (pairs.behind_one = items(&arrays, behind_one, "behind_one", "?", pairs.count, 0, 0, 0)) &&
        (pairs.at_hole = items(&arrays, at_hole, "at_hole", "?", pairs.count, 0, 0, 0)) &&
        (up == Py_None || (along = upward(&arrays, up))) &&
        (out = items(&arrays, features, "features", "f", pairs.count, OF_BOTH, 0, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = describe_pairs(&patches, &pairs, along, out);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

PyObject *call_describe_groups(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *sums, *bins, *sides, *up, *features, *answer = NULL;
    PatchSums groups;
    if (!PyArg_ParseTuple(arguments, "OOOpOO", &sums, &bins, &sides, &groups.with_table, &up, &features))
        return NULL;
    Arrays arrays = {.count = 0};
    const double *along = NULL;
    float *out;
    if (sums_of(&arrays, sums, bins, sides, &groups) && (up == Py_None || (along = upward(&arrays, up))) &&
        (out = items(&arrays, features, "features", "f", groups.count, OF_GROUP, 0, 1))) {
        Py_BEGIN_ALLOW_THREADS
        describe_groups(&groups, along, out);
        Py_END_ALLOW_THREADS
        answer = Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

PyObject *call_describe_borders(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *fitted, *slopes, *normals, *positions, *height, *labels, *up, *inner, *outer, *steps, *forward, *along_row,
        *start, *first, *second, *adjoining, *sums, *sides, *features, *in_front, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OOOOOOOOOOOOOOOOOOOO", &fitted, &slopes, &normals, &positions, &height, &labels, &up,
                          &inner, &outer, &steps, &along_row, &forward, &start, &first, &second, &adjoining, &sums, &sides,
                          &features, &in_front))
        return NULL;
    Arrays arrays = {.count = 0};
    BorderImage on = {.up = NULL};
    PixelPairs pixels;
    BorderPatches patches;
    Py_buffer *added;
    float *out;
    int64_t *shown;
    if ((on.fitted = image(&arrays, fitted, "fitted", &on.h, &on.w)) &&
        (on.slopes = items(&arrays, slopes, "slopes", "f", on.h, on.w, 2, 0)) &&
        (on.normals = items(&arrays, normals, "normals", "f", on.h, on.w, 3, 0)) &&
        (on.positions = items(&arrays, positions, "positions", "f", on.h, on.w, 3, 0)) &&
        (on.height = items(&arrays, height, "height", "f", on.h, on.w, 0, 0)) &&
        (on.labels = items(&arrays, labels, "labels", INT32, on.h, on.w, 0, 0)) &&
        (up == Py_None || (on.up = upward(&arrays, up))) &&
        (pixels.inner = list(&arrays, inner, "inner", INT64, &pixels.count)) &&
        (pixels.outer = items(&arrays, outer, "outer", INT64, pixels.count, 0, 0, 0)) &&
        (pixels.steps = items(&arrays, steps, "steps", INT64, pixels.count, 0, 0, 0)) &&
        (pixels.along_row = items(&arrays, along_row, "along_row", "?", pixels.count, 0, 0, 0)) &&
        (pixels.forward = items(&arrays, forward, "forward", INT64, pixels.count, 0, 0, 0)) &&
        (patches.first = list(&arrays, first, "first", INT64, &patches.pairs)) &&
        (patches.second = items(&arrays, second, "second", INT64, patches.pairs, 0, 0, 0)) &&
        (patches.start = items(&arrays, start, "start", INT64, patches.pairs + 1, 0, 0, 0)) &&
        (patches.adjoining = items(&arrays, adjoining, "adjoining", INT64, patches.pairs, 0, 0, 0)) &&
        (added = array_argument(&arrays, sums, "sums", "d", 2, 1, SUMS, 0)) &&
        (patches.sides = items(&arrays, sides, "sides", "d", added->shape[0], SIDES, 0, 0)) &&
        (out = items(&arrays, features, "features", "f", patches.pairs, AT_BORDER, 0, 1)) &&
        (shown = items(&arrays, in_front, "in_front", INT64, 2, patches.pairs, 0, 1))) {
        patches.sums = added->buf;
        patches.count = added->shape[0];
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = describe_borders(&on, &pixels, &patches, out, shown);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}
