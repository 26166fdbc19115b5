/* The Python side of the compiled kernels. */
#include "array_arguments.h"
#include "preprocessing.h"

/* Raised whenever a function here takes or returns something else; compiled.py names the one that it knows. */
#define INTERFACE 4

/* A contiguous array of `ndim` dimensions with something in it, the last of length 3 unless there is but one; NULL with
 * an error if not. */
static Py_buffer *array(Arrays *arrays, PyObject *from, const char *name, const char *formats, int ndim, int writable)
{
    Py_buffer *view = array_argument(arrays, from, name, formats, ndim, ndim - 1, ndim > 1 ? 3 : -1, writable);
    if (!view || view->shape[0] >= 1)
        return view;
    PyErr_Format(PyExc_ValueError, "%s: another shape is needed", name);
    return NULL;
}

static PyObject *sample(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *sampled, *answer = NULL;
    Py_ssize_t start;
    if (!PyArg_ParseTuple(arguments, "OnO", &points, &start, &sampled))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *cloud, *out;
    if ((cloud = array(&arrays, points, "points", "fd", 2, 0)) &&
        (out = array(&arrays, sampled, "sampled", "f", 2, 1))) {
        if (out->shape[0] > cloud->shape[0] || start < -1 || start >= cloud->shape[0]) {
            PyErr_SetString(PyExc_ValueError, "sampled or start: the cloud has fewer points");
        } else {
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = sample_cloud(cloud->buf, cloud->format[0] == 'd', cloud->shape[0], out->shape[0], start, out->buf);
            Py_END_ALLOW_THREADS
            answer = code < 0 ? PyErr_NoMemory() : PyBool_FromLong(code);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *group(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *order, *answer = NULL;
    Py_ssize_t size;
    if (!PyArg_ParseTuple(arguments, "OnO", &points, &size, &order))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *cloud, *out;
    if ((cloud = array(&arrays, points, "points", "f", 2, 0)) && (out = array(&arrays, order, "order", "lq", 1, 1))) {
        const Py_ssize_t n = cloud->shape[0];
        char *taken;
        if (out->shape[0] != n || size < 1 || n % size) {
            PyErr_SetString(PyExc_ValueError, "order or size: does not fit the points");
        } else if (!(taken = calloc((size_t)n, 2 * sizeof(int64_t) + sizeof(float) + 1))) {
            PyErr_NoMemory();
        } else {
            int64_t *sorted = (int64_t *)taken; /* 2 n of these, n floats and n bytes in one piece */
            float *spare = (float *)(sorted + 2 * n);
            group_points(cloud->buf, n, size, out->buf, spare, (char *)(spare + n), sorted);
            free(taken);
            answer = Py_NewRef(Py_None);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *arrange(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *candidates, *anchors, *signs, *arranged, *answer = NULL;
    int principal, each_axis;
    if (!PyArg_ParseTuple(arguments, "OOOppO", &candidates, &anchors, &signs, &principal, &each_axis, &arranged))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *cloud, *at, *views, *out;
    if ((cloud = array(&arrays, candidates, "candidates", "f", 2, 0)) &&
        (at = array(&arrays, anchors, "anchors", "f", 2, 0)) && (views = array(&arrays, signs, "signs", "f", 2, 0)) &&
        (out = array(&arrays, arranged, "arranged", "f", 3, 1))) {
        if (out->shape[0] != views->shape[0] || out->shape[1] != at->shape[0]) {
            PyErr_SetString(PyExc_ValueError, "arranged: a row for each sign and anchor is needed");
        } else {
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = arrange_cloud(cloud->buf, cloud->shape[0], at->buf, at->shape[0], views->buf, views->shape[0], principal,
                                 each_axis, out->buf);
            Py_END_ALLOW_THREADS
            answer = code ? Py_NewRef(Py_None) : PyErr_NoMemory();
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *describe(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *described, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OO", &points, &described))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *cloud, *out;
    if ((cloud = array(&arrays, points, "points", "f", 2, 0)) &&
        (out = array(&arrays, described, "described", "d", 1, 1))) {
        if (out->shape[0] != 37)
            PyErr_SetString(PyExc_ValueError, "described: 37 numbers are needed");
        else
            answer = describe_points(cloud->buf, cloud->shape[0], out->buf) ? Py_NewRef(Py_None) : PyErr_NoMemory();
    }
    release(&arrays);
    return answer;
}

static PyObject *forms(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *formed, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OO", &points, &formed))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *cloud, *out;
    if ((cloud = array(&arrays, points, "points", "f", 2, 0)) && (out = array(&arrays, formed, "formed", "d", 1, 1))) {
        if (out->shape[0] != 78 || cloud->shape[0] < 2) {
            PyErr_SetString(PyExc_ValueError, "formed or points: 78 numbers are needed, of two points at least");
        } else {
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = surface_forms(cloud->buf, cloud->shape[0], out->buf);
            Py_END_ALLOW_THREADS
            answer = code ? Py_NewRef(Py_None) : PyErr_NoMemory();
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *isolation(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *distances, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OO", &points, &distances))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *cloud, *out;
    if ((cloud = array(&arrays, points, "points", "d", 2, 0)) &&
        (out = array(&arrays, distances, "distances", "d", 1, 1))) {
        if (out->shape[0] != cloud->shape[0]) {
            PyErr_SetString(PyExc_ValueError, "distances: one for each point is needed");
        } else {
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = isolations(cloud->buf, cloud->shape[0], out->buf);
            Py_END_ALLOW_THREADS
            answer = code ? Py_NewRef(Py_None) : PyErr_NoMemory();
        }
    }
    release(&arrays);
    return answer;
}

static PyMethodDef methods[] = {
    {"sample", sample, METH_VARARGS, "Centred farthest points; False where the cloud is for the reference to judge."},
    {"group", group, METH_VARARGS, "See ordering.group_order: fills `order`."},
    {"arrange", arrange, METH_VARARGS, "Fixed positions take their nearest points: fills `arranged`."},
    {"describe", describe, METH_VARARGS, "See known.shape_distribution: fills `described`."},
    {"forms", forms, METH_VARARGS, "See known.surface_forms: fills `formed`."},
    {"isolation", isolation, METH_VARARGS, "See isolated.isolation: fills `distances`."},
    {NULL, NULL, 0, NULL},
};

KERNEL_MODULE("pec.preprocessing._kernels",
              "The compiled half of preprocessing one cloud. compiled.py is its only caller.")
