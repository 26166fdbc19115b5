/* The Python side of the compiled kernels: sizes and types are checked here, so that the kernels can trust them.
 * Arrays come in through the buffer protocol: no header of NumPy is needed, and none of its versions preferred. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "preprocessing.h"

#include <string.h>

/* Raised whenever a function here takes or returns something else; pec/kernels.py names the one that it knows. */
#define INTERFACE 1

#define MOST_BUFFERS 4

/* The buffers that one call holds. */
typedef struct {
    Py_buffer views[MOST_BUFFERS];
    int count;
} Held;

static void release(Held *held)
{
    while (held->count > 0)
        PyBuffer_Release(&held->views[--held->count]);
}

/* A contiguous array of `ndim` dimensions, the last of length 3 unless there is but one; NULL with an error if not. */
static Py_buffer *array(Held *held, PyObject *from, const char *name, const char *formats, int ndim, int writable)
{
    Py_buffer *view = &held->views[held->count];
    if (PyObject_GetBuffer(from, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0)) < 0)
        return NULL;
    held->count++;
    if (!view->format || strlen(view->format) != 1 || !strchr(formats, view->format[0]))
        PyErr_Format(PyExc_TypeError, "%s: items of another type", name);
    else if (view->ndim != ndim || view->shape[0] < 1 || (ndim > 1 && view->shape[ndim - 1] != 3))
        PyErr_Format(PyExc_ValueError, "%s: another shape is needed", name);
    else
        return view;
    return NULL;
}

static PyObject *sample(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *sampled, *answer = NULL;
    Py_ssize_t start;
    if (!PyArg_ParseTuple(arguments, "OnO", &points, &start, &sampled))
        return NULL;
    Held held = {.count = 0};
    Py_buffer *cloud, *out;
    if ((cloud = array(&held, points, "points", "fd", 2, 0)) && (out = array(&held, sampled, "sampled", "f", 2, 1))) {
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
    release(&held);
    return answer;
}

static PyObject *group(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *order, *answer = NULL;
    Py_ssize_t size;
    if (!PyArg_ParseTuple(arguments, "OnO", &points, &size, &order))
        return NULL;
    Held held = {.count = 0};
    Py_buffer *cloud, *out;
    if ((cloud = array(&held, points, "points", "f", 2, 0)) && (out = array(&held, order, "order", "lq", 1, 1))) {
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
    release(&held);
    return answer;
}

static PyObject *arrange(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *candidates, *anchors, *signs, *arranged, *answer = NULL;
    int principal, each_axis;
    if (!PyArg_ParseTuple(arguments, "OOOppO", &candidates, &anchors, &signs, &principal, &each_axis, &arranged))
        return NULL;
    Held held = {.count = 0};
    Py_buffer *cloud, *at, *views, *out;
    if ((cloud = array(&held, candidates, "candidates", "f", 2, 0)) && (at = array(&held, anchors, "anchors", "f", 2, 0)) &&
        (views = array(&held, signs, "signs", "f", 2, 0)) && (out = array(&held, arranged, "arranged", "f", 3, 1))) {
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
    release(&held);
    return answer;
}

static PyMethodDef methods[] = {
    {"sample", sample, METH_VARARGS, "Centred farthest points; False where the cloud is for the reference to judge."},
    {"group", group, METH_VARARGS, "See ordering.group_order: fills `order`."},
    {"arrange", arrange, METH_VARARGS, "Fixed positions take their nearest points: fills `arranged`."},
    {NULL, NULL, 0, NULL},
};

static int execute(PyObject *module)
{
    return PyModule_AddIntConstant(module, "INTERFACE", INTERFACE);
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, (void *)execute}, {0, NULL}};

static struct PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "pec._kernels",
    .m_doc = "The compiled half of preprocessing one cloud. pec/kernels.py is its only caller.",
    .m_methods = methods,
    .m_slots = slots,
};

PyMODINIT_FUNC PyInit__kernels(void)
{
    return PyModuleDef_Init(&definition);
}
