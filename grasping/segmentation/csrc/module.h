/* What the Python side of the kernels is made of: a function a kernel, which checks its arguments before it calls it. */
#ifndef GRASPING_SEGMENTATION_MODULE_H
#define GRASPING_SEGMENTATION_MODULE_H

#include "array_arguments.h"
#include "segmentation.h"

#define INT32 "il"
#define INT64 "lq"

/* The items of a contiguous array (first, second, third), whose lengths must be these; 0 stands for no such dimension.
 * NULL with an error if not. */
static inline void *items(Arrays *arrays, PyObject *from, const char *name, const char *formats, Py_ssize_t first,
                   Py_ssize_t second, Py_ssize_t third, int writable)
{
    const Py_ssize_t shape[3] = {first, second, third};
    const int ndim = third ? 3 : second ? 2 : 1;
    Py_buffer *view = array_argument(arrays, from, name, formats, ndim, 0, -1, writable);
    for (int axis = 0; view && axis < ndim; axis++)
        if (view->shape[axis] != shape[axis]) {
            PyErr_Format(PyExc_ValueError, "%s: another shape is needed", name);
            view = NULL;
        }
    return view ? view->buf : NULL;
}

/* A list of whatever length, which comes back in `count`. */
static inline const void *list(Arrays *arrays, PyObject *from, const char *name, const char *formats, Py_ssize_t *count)
{
    const Py_buffer *view = array_argument(arrays, from, name, formats, 1, 0, -1, 0);
    if (!view)
        return NULL;
    *count = view->shape[0];
    return view->buf;
}

/* An image of float32, by which all others are judged: of a pixel at least. */
static inline const float *image(Arrays *arrays, PyObject *from, const char *name, Py_ssize_t *h, Py_ssize_t *w)
{
    const Py_buffer *view = array_argument(arrays, from, name, "f", 2, 0, -1, 0);
    if (!view)
        return NULL;
    *h = view->shape[0];
    *w = view->shape[1];
    if (*h >= 1 && *w >= 1)
        return view->buf;
    PyErr_Format(PyExc_ValueError, "%s: no pixels", name);
    return NULL;
}

static inline PyObject *failure(ptrdiff_t code)
{
    if (code == OUT_OF_RANGE)
        return PyErr_Format(PyExc_ValueError, "an index points out of the array that it is for");
    return PyErr_NoMemory();
}

/* The number of pixels must fit into int32, as labels do. */
static inline int32_t *labels_of(Arrays *arrays, PyObject *from, Py_ssize_t *h, Py_ssize_t *w, int writable)
{
    Py_buffer *view = array_argument(arrays, from, "labels", INT32, 2, 0, -1, writable);
    if (!view)
        return NULL;
    *h = view->shape[0];
    *w = view->shape[1];
    if (*h >= 1 && *w >= 1 && *h <= INT32_MAX / *w)
        return view->buf;
    PyErr_SetString(PyExc_ValueError, "labels: no pixels, or too many");
    return NULL;
}

/* In calls_of_frames.c. */
PyObject *call_single_pixels(PyObject *self, PyObject *arguments);
PyObject *call_square_distances(PyObject *self, PyObject *arguments);
PyObject *call_rise_over_plane(PyObject *self, PyObject *arguments);

/* In calls_of_tables.c. */
PyObject *call_find_heights(PyObject *self, PyObject *arguments);
PyObject *call_rise_over_table(PyObject *self, PyObject *arguments);
PyObject *call_mean_of_nine(PyObject *self, PyObject *arguments);
PyObject *call_stand_out(PyObject *self, PyObject *arguments);
PyObject *call_find_wrinkles(PyObject *self, PyObject *arguments);
PyObject *call_draw_plane(PyObject *self, PyObject *arguments);
PyObject *call_refine_plane(PyObject *self, PyObject *arguments);
/* In calls_of_pairs.c. */
PyObject *call_describe_borders(PyObject *self, PyObject *arguments);
PyObject *call_describe_pairs(PyObject *self, PyObject *arguments);
PyObject *call_describe_groups(PyObject *self, PyObject *arguments);

#endif
