/* The Python side of frame_points.c. */
#include "module.h"

PyObject *call_single_pixels(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *chosen, *single, *answer = NULL;
    Py_ssize_t columns, count;
    if (!PyArg_ParseTuple(arguments, "OOnO", &points, &chosen, &columns, &single))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *from;
    const int64_t *pixels;
    unsigned char *out;
    if ((from = array_argument(&arrays, points, "points", "fd", 2, 1, 3, 0)) &&
        (pixels = list(&arrays, chosen, "chosen", INT64, &count)) &&
        (out = items(&arrays, single, "single", "?", count, 0, 0, 1))) {
        if (columns < 1) {
            PyErr_SetString(PyExc_ValueError, "columns: at least one is needed");
        } else {
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = find_single_pixels(from->buf, from->format[0] == 'd', from->shape[0], columns, pixels, count, out);
            Py_END_ALLOW_THREADS
            answer = code ? failure(code) : Py_NewRef(Py_None);
        }
    }
    release(&arrays);
    return answer;
}

PyObject *call_square_distances(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *squared, *valid, *answer = NULL;
    double nearest, farthest;
    if (!PyArg_ParseTuple(arguments, "OddOO", &points, &nearest, &farthest, &squared, &valid))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *from;
    unsigned char *is;
    void *out;
    if ((from = array_argument(&arrays, points, "points", "fd", 2, 1, 3, 0)) &&
        (out = items(&arrays, squared, "squared", from->format[0] == 'd' ? "d" : "f", from->shape[0], 0, 0, 1)) &&
        (is = items(&arrays, valid, "valid", "?", from->shape[0], 0, 0, 1))) {
        Py_BEGIN_ALLOW_THREADS
        square_distances(from->buf, from->format[0] == 'd', from->shape[0], nearest, farthest, out, is);
        Py_END_ALLOW_THREADS
        answer = Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

PyObject *call_rise_over_plane(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *valid, *heights, *answer = NULL;
    double plane[4];
    if (!PyArg_ParseTuple(arguments, "OOddddO", &points, &valid, &plane[0], &plane[1], &plane[2], &plane[3], &heights))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *from;
    const unsigned char *is;
    void *out;
    if ((from = array_argument(&arrays, points, "points", "fd", 2, 1, 3, 0)) &&
        (is = items(&arrays, valid, "valid", "?", from->shape[0], 0, 0, 0)) &&
        (out = items(&arrays, heights, "heights", from->format[0] == 'd' ? "d" : "f", from->shape[0], 0, 0, 1))) {
        Py_BEGIN_ALLOW_THREADS
        rise_over_plane(from->buf, from->format[0] == 'd', is, from->shape[0], plane, out);
        Py_END_ALLOW_THREADS
        answer = Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}
