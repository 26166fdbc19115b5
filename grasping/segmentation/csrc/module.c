/* The Python side of the compiled kernels. */
#include "module.h"

#include <stdlib.h>

/* Raised whenever a function here takes or returns something else; kernels.py names the one that it knows. */
#define INTERFACE 6

static PyObject *reduce(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *inverse_depth, *reduced, *answer = NULL;
    Py_ssize_t block, h, w;
    if (!PyArg_ParseTuple(arguments, "OnO", &inverse_depth, &block, &reduced))
        return NULL;
    Arrays arrays = {.count = 0};
    const float *q;
    float *out;
    if ((q = image(&arrays, inverse_depth, "inverse_depth", &h, &w))) {
        if (block < 1 || block > h || block > w) {
            PyErr_SetString(PyExc_ValueError, "block: the image is smaller");
        } else if ((out = items(&arrays, reduced, "reduced", "f", h / block, w / block, 0, 1))) {
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = reduce_blocks(q, h, w, block, out);
            Py_END_ALLOW_THREADS
            answer = code ? failure(code) : Py_NewRef(Py_None);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *place(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *inverse_depth, *along, *down, *positions, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OOOO", &inverse_depth, &along, &down, &positions))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t h, w;
    const float *q, *columns, *rows;
    float *out;
    if ((q = image(&arrays, inverse_depth, "inverse_depth", &h, &w)) &&
        (columns = items(&arrays, along, "along", "f", w, 3, 0, 0)) &&
        (rows = items(&arrays, down, "down", "f", h, 3, 0, 0)) &&
        (out = items(&arrays, positions, "positions", "f", h, w, 3, 1))) {
        Py_BEGIN_ALLOW_THREADS
        find_positions(q, h, w, columns, rows, out);
        Py_END_ALLOW_THREADS
        answer = Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

static PyObject *invert(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *valid, *inverse_depth, *answer = NULL;
    double towards[4];
    if (!PyArg_ParseTuple(arguments, "OOddddO", &points, &valid, &towards[0], &towards[1], &towards[2], &towards[3],
                          &inverse_depth))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *from;
    const unsigned char *is;
    float *out;
    if ((from = array_argument(&arrays, points, "points", "fd", 2, 1, 3, 0)) &&
        (is = items(&arrays, valid, "valid", "?", from->shape[0], 0, 0, 0)) &&
        (out = items(&arrays, inverse_depth, "inverse_depth", "f", from->shape[0], 0, 0, 1))) {
        Py_BEGIN_ALLOW_THREADS
        invert_depths(from->buf, from->format[0] == 'd', is, from->shape[0], towards, out);
        Py_END_ALLOW_THREADS
        answer = Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

static PyObject *pieces(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *mask, *labels, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OO", &mask, &labels))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t h, w;
    const unsigned char *is;
    int32_t *out;
    if ((out = labels_of(&arrays, labels, &h, &w, 1)) && (is = items(&arrays, mask, "mask", "?", h, w, 0, 0))) {
        ptrdiff_t count;
        Py_BEGIN_ALLOW_THREADS
        count = label_pieces(is, h, w, out);
        Py_END_ALLOW_THREADS
        answer = count < 0 ? failure(count) : PyLong_FromSsize_t(count);
    }
    release(&arrays);
    return answer;
}

static PyObject *borders(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *labels, *unknown, *steps, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OOO", &labels, &unknown, &steps))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t h, w;
    const int32_t *from;
    const unsigned char *is;
    unsigned char *out;
    if ((from = labels_of(&arrays, labels, &h, &w, 0)) && (is = items(&arrays, unknown, "unknown", "?", h, w, 0, 0)) &&
        (out = items(&arrays, steps, "steps", "B", 2, h, w, 1))) {
        Py_BEGIN_ALLOW_THREADS
        steps_to_borders(from, is, h, w, out);
        Py_END_ALLOW_THREADS
        answer = Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

static PyObject *fit(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *inverse_depth, *asked, *to_frame, *fitted, *slopes, *normals, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OOOOOO", &inverse_depth, &asked, &to_frame, &fitted, &slopes, &normals))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t h, w, count;
    const float *q, *turn;
    const int64_t *pixels;
    float *at, *along, *across;
    if ((q = image(&arrays, inverse_depth, "inverse_depth", &h, &w)) &&
        (pixels = list(&arrays, asked, "asked", INT64, &count)) &&
        (turn = items(&arrays, to_frame, "to_frame", "f", 3, 3, 0, 0)) &&
        (at = items(&arrays, fitted, "fitted", "f", h, w, 0, 1)) &&
        (along = items(&arrays, slopes, "slopes", "f", h, w, 2, 1)) &&
        (across = items(&arrays, normals, "normals", "f", h, w, 3, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = fit_surfaces(q, h, w, pixels, count, turn, at, along, across);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

static PyObject *edges(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *fitted, *slopes, *normals, *positions, *asked, *edge, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OOOOOO", &fitted, &slopes, &normals, &positions, &asked, &edge))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t h, w, count;
    const float *at, *along, *across, *place;
    const int64_t *pixels;
    float *out;
    if ((at = image(&arrays, fitted, "fitted", &h, &w)) &&
        (along = items(&arrays, slopes, "slopes", "f", h, w, 2, 0)) &&
        (across = items(&arrays, normals, "normals", "f", h, w, 3, 0)) &&
        (place = items(&arrays, positions, "positions", "f", h, w, 3, 0)) &&
        (pixels = list(&arrays, asked, "asked", INT64, &count)) &&
        (out = items(&arrays, edge, "edge", "f", h, w, 0, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = find_edges(at, along, across, place, h, w, pixels, count, out);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

static PyObject *grow(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *edge, *fitted, *labels, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OOO", &edge, &fitted, &labels))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t h, w;
    const float *edges_, *at;
    int32_t *out;
    if ((edges_ = image(&arrays, edge, "edge", &h, &w)) && (at = items(&arrays, fitted, "fitted", "f", h, w, 0, 0)) &&
        (out = items(&arrays, labels, "labels", INT32, h, w, 0, 1))) {
        ptrdiff_t count;
        Py_BEGIN_ALLOW_THREADS
        count = grow_patches(edges_, at, h, w, out);
        Py_END_ALLOW_THREADS
        answer = count < 0 ? failure(count) : PyLong_FromSsize_t(count);
    }
    release(&arrays);
    return answer;
}

static PyObject *merge(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *edge, *labels, *answer = NULL;
    Py_ssize_t count, h, w;
    if (!PyArg_ParseTuple(arguments, "OOn", &edge, &labels, &count))
        return NULL;
    Arrays arrays = {.count = 0};
    const float *edges_;
    int32_t *out;
    if ((edges_ = image(&arrays, edge, "edge", &h, &w)) && (out = items(&arrays, labels, "labels", INT32, h, w, 0, 1))) {
        if (count < 0 || count > h * w) {
            PyErr_SetString(PyExc_ValueError, "count: more patches than pixels");
        } else {
            ptrdiff_t left;
            Py_BEGIN_ALLOW_THREADS
            left = merge_patches(edges_, h, w, out, count);
            Py_END_ALLOW_THREADS
            answer = left < 0 ? failure(left) : PyLong_FromSsize_t(left);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *measure(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *inverse_depth, *normals, *positions, *labels, *edge, *height, *table, *above, *sums, *bins, *sides,
        *answer = NULL;
    Measured on;
    if (!PyArg_ParseTuple(arguments, "OOOOOOOOddOOO", &inverse_depth, &normals, &positions, &labels, &edge, &height,
                          &table, &above, &on.pixel, &on.noise, &sums, &bins, &sides))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *added;
    double *heights, *outlines;
    if ((on.inverse_depth = image(&arrays, inverse_depth, "inverse_depth", &on.h, &on.w)) &&
        (on.normals = items(&arrays, normals, "normals", "f", on.h, on.w, 3, 0)) &&
        (on.positions = items(&arrays, positions, "positions", "f", on.h, on.w, 3, 0)) &&
        (on.labels = items(&arrays, labels, "labels", INT32, on.h, on.w, 0, 0)) &&
        (on.edge = items(&arrays, edge, "edge", "f", on.h, on.w, 0, 0)) &&
        (on.height = items(&arrays, height, "height", "f", on.h, on.w, 0, 0)) &&
        (on.table = items(&arrays, table, "table", "?", on.h, on.w, 0, 0)) &&
        (on.above = items(&arrays, above, "above", "f", on.h, on.w, 0, 0)) &&
        (added = array_argument(&arrays, sums, "sums", "d", 2, 1, SUMS, 1)) &&
        (heights = items(&arrays, bins, "bins", "d", added->shape[0], BINS, 0, 1)) &&
        (outlines = items(&arrays, sides, "sides", "d", added->shape[0], SIDES, 0, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = measure_patches(&on, added->shape[0], added->buf, heights, outlines);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

#define PACKED "grasping.segmentation.PackedTrees"

static void unpack(PyObject *capsule) { free(PyCapsule_GetPointer(capsule, PACKED)); }

static PyObject *pack(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *feature, *threshold, *left, *right, *missing_left, *value, *start, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OOOOOOO", &feature, &threshold, &left, &right, &missing_left, &value, &start))
        return NULL;
    Arrays arrays = {.count = 0};
    Trees trees;
    if ((trees.feature = list(&arrays, feature, "feature", INT32, &trees.nodes)) &&
        (trees.threshold = items(&arrays, threshold, "threshold", "f", trees.nodes, 0, 0, 0)) &&
        (trees.left = items(&arrays, left, "left", INT32, trees.nodes, 0, 0, 0)) &&
        (trees.right = items(&arrays, right, "right", INT32, trees.nodes, 0, 0, 0)) &&
        (trees.missing_left = items(&arrays, missing_left, "missing_left", INT32, trees.nodes, 0, 0, 0)) &&
        (trees.value = items(&arrays, value, "value", "d", trees.nodes, 0, 0, 0)) &&
        (trees.start = list(&arrays, start, "start", INT32, &trees.trees))) {
        PackedTrees *packed = NULL;
        const int code = pack_trees(&trees, &packed);
        answer = code ? failure(code) : PyCapsule_New(packed, PACKED, unpack);
        if (!code && !answer)
            free(packed);
    }
    release(&arrays);
    return answer;
}

static PyObject *boost(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *capsule, *features, *odds, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OOO", &capsule, &features, &odds))
        return NULL;
    Arrays arrays = {.count = 0};
    const PackedTrees *trees;
    Py_buffer *rows;
    double *out;
    if ((trees = PyCapsule_GetPointer(capsule, PACKED)) &&
        (rows = array_argument(&arrays, features, "features", "f", 2, 0, -1, 0)) &&
        (out = items(&arrays, odds, "odds", "d", rows->shape[0], 0, 0, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = add_trees(trees, rows->buf, rows->shape[0], rows->shape[1], out);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

static PyObject *group(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *first, *second, *agreement, *root, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OOOO", &first, &second, &agreement, &root))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t pairs;
    Py_buffer *out;
    const int64_t *low, *high;
    const double *values;
    if ((low = list(&arrays, first, "first", INT64, &pairs)) &&
        (high = items(&arrays, second, "second", INT64, pairs, 0, 0, 0)) &&
        (values = items(&arrays, agreement, "agreement", "d", pairs, 0, 0, 0)) &&
        (out = array_argument(&arrays, root, "root", INT64, 1, 0, -1, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = cluster(low, high, values, pairs, out->shape[0], out->buf);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

static PyMethodDef methods[] = {
    {"single_pixels", call_single_pixels, METH_VARARGS, "See flying_pixels.single_pixels: fills `single`."},
    {"square_distances", call_square_distances, METH_VARARGS, "See frame.distances: fills `squared` and `valid`."},
    {"rise_over_plane", call_rise_over_plane, METH_VARARGS, "See planes.heights_above: fills `heights`."},
    {"positions", place, METH_VARARGS, "See working_image.positions: fills `positions`."},
    {"inverse_depths", invert, METH_VARARGS, "See working_image.inverse_depths: fills `inverse_depth`."},
    {"find_heights", call_find_heights, METH_VARARGS, "See table_relief.heights_over: fills `plane` and `height`."},
    {"rise_over_table", call_rise_over_table, METH_VARARGS, "See table_relief.relief: fills `table` and `above`."},
    {"mean_of_nine", call_mean_of_nine, METH_VARARGS, "See table_relief.mean_of_nine: fills `mean`."},
    {"stand_out", call_stand_out, METH_VARARGS, "See table_relief.stand_out: fills `found`."},
    {"find_wrinkles", call_find_wrinkles, METH_VARARGS, "See wrinkles.wrinkles: fills `found`."},
    {"draw_plane", call_draw_plane, METH_VARARGS, "See planes.draw_plane: fills `plane`, returns whether there is one."},
    {"refine_plane", call_refine_plane, METH_VARARGS, "See planes.refine: changes `plane`, returns (width, residual)."},
    {"label_pieces", pieces, METH_VARARGS, "See pieces.label_pieces: fills `labels`, returns the number."},
    {"steps_to_borders", borders, METH_VARARGS, "See patch_pairs.steps_to_borders: fills `steps`."},
    {"reduce_blocks", reduce, METH_VARARGS, "See working_image.reduce_blocks: fills `reduced`."},
    {"fit_surfaces", fit, METH_VARARGS, "See surface_fits.fit_surfaces: fills what was asked for."},
    {"edges", edges, METH_VARARGS, "See surface_patches.edges: fills what was asked for."},
    {"grow_patches", grow, METH_VARARGS, "See surface_patches.grow_patches_reference: fills `labels`, returns the number."},
    {"merge_patches", merge, METH_VARARGS, "See surface_patches.merge_patches_reference: changes `labels`, likewise."},
    {"measure_patches", measure, METH_VARARGS, "See patch_measures.sums_reference: adds to sums, bins and sides."},
    {"describe_borders", call_describe_borders, METH_VARARGS, "See pair_features.border_features: fills the last two."},
    {"describe_pairs", call_describe_pairs, METH_VARARGS, "See pair_features.shape_features: fills `features`."},
    {"describe_groups", call_describe_groups, METH_VARARGS, "See group_features.shapes_of_groups: fills `features`."},
    {"pack_trees", pack, METH_VARARGS, "The same trees as `add_trees` takes them."},
    {"add_trees", boost, METH_VARARGS, "See boosted_trees.BoostedTrees.log_odds: adds to `odds`."},
    {"cluster", group, METH_VARARGS, "See correlation_clustering.cluster_reference: fills `root`."},
    {NULL, NULL, 0, NULL},
};

KERNEL_MODULE("grasping.segmentation._kernels", "The compiled pixel loops of the segmenter.")
