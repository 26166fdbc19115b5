/* The Python side of planes.c, relief.c, mean_of_nine.c and wrinkles.c. */
#include "module.h"

PyObject *call_find_heights(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *inverse_depth, *across, *down, *plane, *height, *answer = NULL;
    float camera;
    if (!PyArg_ParseTuple(arguments, "OOOfOO", &inverse_depth, &across, &down, &camera, &plane, &height))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t h, w;
    const float *q, *columns, *rows;
    float *level, *high;
    if ((q = image(&arrays, inverse_depth, "inverse_depth", &h, &w)) &&
        (columns = items(&arrays, across, "across", "f", w, 0, 0, 0)) &&
        (rows = items(&arrays, down, "down", "f", h, 0, 0, 0)) &&
        (level = items(&arrays, plane, "plane", "f", h, w, 0, 1)) &&
        (high = items(&arrays, height, "height", "f", h, w, 0, 1))) {
        Py_BEGIN_ALLOW_THREADS
        find_heights(q, h, w, columns, rows, camera, level, high);
        Py_END_ALLOW_THREADS
        answer = Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

PyObject *call_rise_over_table(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *inverse_depth, *plane, *bend, *table, *above, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OOOOO", &inverse_depth, &plane, &bend, &table, &above))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t h, w;
    const float *q, *level, *bent;
    float *of_table, *over;
    if ((q = image(&arrays, inverse_depth, "inverse_depth", &h, &w)) &&
        (level = items(&arrays, plane, "plane", "f", h, w, 0, 0)) &&
        (bent = items(&arrays, bend, "bend", "f", h, w, 0, 0)) &&
        (of_table = items(&arrays, table, "table", "f", h, w, 0, 1)) &&
        (over = items(&arrays, above, "above", "f", h, w, 0, 1))) {
        Py_BEGIN_ALLOW_THREADS
        rise_over_table(q, level, bent, h * w, of_table, over);
        Py_END_ALLOW_THREADS
        answer = Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

PyObject *call_mean_of_nine(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *values, *inverse_depth, *mean, *answer = NULL;
    float most;
    if (!PyArg_ParseTuple(arguments, "OOfO", &values, &inverse_depth, &most, &mean))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t h, w;
    const float *from, *q;
    float *out;
    if ((from = image(&arrays, values, "values", &h, &w)) &&
        (q = items(&arrays, inverse_depth, "inverse_depth", "f", h, w, 0, 0)) &&
        (out = items(&arrays, mean, "mean", "f", h, w, 0, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = mean_of_nine(from, q, h, w, most, out);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

PyObject *call_stand_out(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *inverse_depth, *above, *mean, *height, *found, *answer = NULL;
    Standing from;
    if (!PyArg_ParseTuple(arguments, "OOOOffffO", &inverse_depth, &above, &mean, &height, &from.least_own,
                          &from.least_mean, &from.least_height, &from.level, &found))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t h, w;
    unsigned char *out;
    if ((from.inverse_depth = image(&arrays, inverse_depth, "inverse_depth", &h, &w)) &&
        (from.above = items(&arrays, above, "above", "f", h, w, 0, 0)) &&
        (from.mean = items(&arrays, mean, "mean", "f", h, w, 0, 0)) &&
        (from.height = items(&arrays, height, "height", "f", h, w, 0, 0)) &&
        (out = items(&arrays, found, "found", "?", h, w, 0, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = stand_out(&from, h, w, out);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

PyObject *call_find_wrinkles(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *labels, *inverse_depth, *above, *stands_out, *found, *answer = NULL;
    Rising on;
    if (!PyArg_ParseTuple(arguments, "OOOOfO", &labels, &inverse_depth, &above, &stands_out, &on.camera, &found))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *out;
    if ((on.inverse_depth = image(&arrays, inverse_depth, "inverse_depth", &on.h, &on.w)) &&
        (on.labels = items(&arrays, labels, "labels", INT32, on.h, on.w, 0, 0)) &&
        (on.above = items(&arrays, above, "above", "f", on.h, on.w, 0, 0)) &&
        (on.stands_out = items(&arrays, stands_out, "stands_out", "?", on.h, on.w, 0, 0)) &&
        (out = array_argument(&arrays, found, "found", "?", 1, 0, -1, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = find_wrinkles(&on, out->shape[0], out->buf);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

PyObject *call_draw_plane(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *corners, *drawn, *tested, *up, *plane, *answer = NULL;
    Draws draws;
    double least_cosine, distance;
    if (!PyArg_ParseTuple(arguments, "OOOOOnddO", &points, &corners, &drawn, &tested, &up, &draws.level, &least_cosine,
                          &distance, &plane))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *cloud, *three, *others;
    const double *upward = NULL;
    double *best;
    if ((cloud = array_argument(&arrays, points, "points", "d", 2, 1, 3, 0)) &&
        (three = array_argument(&arrays, corners, "corners", INT64, 2, 1, 3, 0)) &&
        (others = array_argument(&arrays, drawn, "drawn", INT64, 2, 1, NEARBY, 0)) &&
        (draws.tested = list(&arrays, tested, "tested", INT64, &draws.tests)) &&
        (up == Py_None || (upward = items(&arrays, up, "up", "d", 3, 0, 0, 0))) &&
        (best = items(&arrays, plane, "plane", "d", 4, 0, 0, 1))) {
        draws.corners = three->buf;
        draws.hypotheses = three->shape[0];
        draws.drawn = others->buf;
        draws.half = others->shape[0];
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = draw_plane(cloud->buf, cloud->shape[0], &draws, upward, least_cosine, distance, best);
        Py_END_ALLOW_THREADS
        answer = code < 0 ? failure(code) : PyBool_FromLong(code);
    }
    release(&arrays);
    return answer;
}

PyObject *call_refine_plane(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *plane, *answer = NULL;
    double width, residual, band[2];
    if (!PyArg_ParseTuple(arguments, "OdddO", &points, &width, &band[0], &band[1], &plane))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *cloud;
    double *equation;
    if ((cloud = array_argument(&arrays, points, "points", "d", 2, 1, 3, 0)) &&
        (equation = items(&arrays, plane, "plane", "d", 4, 0, 0, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = refine_plane(cloud->buf, cloud->shape[0], band, equation, &width, &residual);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_BuildValue("dd", width, residual);
    }
    release(&arrays);
    return answer;
}
