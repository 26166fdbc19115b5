/* The Python side of the compiled kernels. */
#include "array_arguments.h"
#include "pose.h"

/* Raised whenever a function here takes or returns something else; kernels.py names the one that it knows. */
#define INTERFACE 3

#define INT32 "il"

static PyObject *failure(int code)
{
    if (code == OUT_OF_RANGE)
        return PyErr_Format(PyExc_ValueError, "an index points out of the array that it is for");
    return PyErr_NoMemory();
}

/* (N, 3), whose length comes back in `count`, or must be it where that is not −1. */
static double *triples(Arrays *arrays, PyObject *from, const char *name, Py_ssize_t *count)
{
    Py_buffer *view = array_argument(arrays, from, name, "d", 2, 1, 3, 0);
    if (!view)
        return NULL;
    if (*count >= 0 && view->shape[0] != *count) {
        PyErr_Format(PyExc_ValueError, "%s: another shape is needed", name);
        return NULL;
    }
    *count = view->shape[0];
    return view->buf;
}

static const int32_t *list(Arrays *arrays, PyObject *from, const char *name, Py_ssize_t *count)
{
    Py_buffer *view = array_argument(arrays, from, name, INT32, 1, 0, *count, 0);
    if (!view)
        return NULL;
    *count = view->shape[0];
    return view->buf;
}

static double *poses_of(Arrays *arrays, PyObject *from, Py_ssize_t *count, int writable)
{
    Py_buffer *view = array_argument(arrays, from, "poses", "d", 3, 1, 4, writable);
    if (!view)
        return NULL;
    if (view->shape[2] != 4) {
        PyErr_SetString(PyExc_ValueError, "poses: another shape is needed");
        return NULL;
    }
    *count = view->shape[0];
    return view->buf;
}

static PyObject *vote(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *starts, *first, *turn, *row, *bins, *turned, *found, *answer = NULL;
    Py_ssize_t points;
    int turns, fine;
    if (!PyArg_ParseTuple(arguments, "OOOOOOniiO", &starts, &first, &turn, &row, &bins, &turned, &points, &turns, &fine,
                          &found))
        return NULL;
    Arrays arrays = {.count = 0};
    Table table = {.points = points, .turns = turns, .fine = fine};
    Py_ssize_t bounds = CELLS + 1, entries = -1, count = -1;
    const int32_t *rows, *angles;
    Py_buffer *numbers, *out;
    if ((table.starts = list(&arrays, starts, "starts", &bounds)) &&
        (table.first = list(&arrays, first, "first", &entries)) && (table.turn = list(&arrays, turn, "turn", &entries)) &&
        (rows = list(&arrays, row, "row", &count)) && (angles = list(&arrays, turned, "turned", &count)) &&
        (numbers = array_argument(&arrays, bins, "bins", "d", 2, 1, 4, 0)) &&
        (out = array_argument(&arrays, found, "found", INT32, 3, 2, 3, 1))) {
        table.entries = entries;
        if (points < 1 || points > 1000000 || turns < 1 || turns > 1000 || fine < 1 || fine > 1000) {
            PyErr_SetString(PyExc_ValueError, "points, turns, fine: out of range");
        } else if (numbers->shape[0] != count) {
            PyErr_SetString(PyExc_ValueError, "bins: another shape is needed");
        } else {
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = count_votes(&table, rows, numbers->buf, angles, count, out->shape[0], out->shape[1], out->buf);
            Py_END_ALLOW_THREADS
            answer = code ? failure(code) : Py_NewRef(Py_None);
        }
    }
    release(&arrays);
    return answer;
}

static int grid_of(Arrays *arrays, PyObject *const from[5], double cell, Grid *grid)
{
    Py_ssize_t count = -1;
    Py_buffer *nearest, *corner, *centre;
    if (!(grid->points = triples(arrays, from[0], "points", &count)) ||
        !(grid->normals = triples(arrays, from[1], "normals", &count)) ||
        !(nearest = array_argument(arrays, from[2], "nearest", INT32, 4, 3, SIDES, 0)) ||
        !(corner = array_argument(arrays, from[3], "corner", "d", 1, 0, 3, 0)) ||
        !(centre = array_argument(arrays, from[4], "centre", "d", 1, 0, 3, 0)))
        return 0;
    if (!(cell > 0.0)) {
        PyErr_SetString(PyExc_ValueError, "cell: must be positive");
        return 0;
    }
    grid->count = count;
    grid->nearest = nearest->buf;
    grid->x = nearest->shape[0];
    grid->y = nearest->shape[1];
    grid->z = nearest->shape[2];
    grid->corner = corner->buf;
    grid->centre = centre->buf;
    grid->cell = cell;
    return 1;
}

static PyObject *align(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *from[5], *points, *normals, *gates, *poses, *answer = NULL;
    double cell;
    if (!PyArg_ParseTuple(arguments, "OOOOdOOOOO", &from[0], &from[1], &from[2], &from[3], &cell, &from[4], &points,
                          &normals, &gates, &poses))
        return NULL;
    Arrays arrays = {.count = 0};
    Grid grid;
    Py_ssize_t count = -1, number = 0;
    const double *of, *facing;
    Py_buffer *steps;
    double *T;
    if (grid_of(&arrays, from, cell, &grid) && (of = triples(&arrays, points, "points", &count)) &&
        (facing = triples(&arrays, normals, "normals", &count)) &&
        (steps = array_argument(&arrays, gates, "gates", "d", 1, 0, -1, 0)) &&
        (T = poses_of(&arrays, poses, &number, 1))) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        if (!(code = check_grid(&grid)))
            align_poses(&grid, of, facing, count, steps->buf, steps->shape[0], T, number);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_NewRef(Py_None);
    }
    release(&arrays);
    return answer;
}

static PyObject *pair_up(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *from[5], *points, *normals, *poses, *partner, *place, *answer = NULL;
    double cell;
    if (!PyArg_ParseTuple(arguments, "OOOOdOOOOOO", &from[0], &from[1], &from[2], &from[3], &cell, &from[4], &points,
                          &normals, &poses, &partner, &place))
        return NULL;
    Arrays arrays = {.count = 0};
    Grid grid;
    Py_ssize_t count = -1, number = 0;
    const double *of, *facing, *T;
    Py_buffer *partners, *places;
    if (grid_of(&arrays, from, cell, &grid) && (of = triples(&arrays, points, "points", &count)) &&
        (facing = triples(&arrays, normals, "normals", &count)) && (T = poses_of(&arrays, poses, &number, 0)) &&
        (partners = array_argument(&arrays, partner, "partner", INT32, 2, 1, count, 1)) &&
        (places = array_argument(&arrays, place, "place", "d", 3, 2, 3, 1))) {
        int code;
        if (partners->shape[0] != number || places->shape[0] != number || places->shape[1] != count) {
            PyErr_SetString(PyExc_ValueError, "partner, place: another shape is needed");
        } else {
            int32_t *found = partners->buf;
            double *at = places->buf;
            Py_BEGIN_ALLOW_THREADS
            code = check_grid(&grid);
            for (Py_ssize_t h = 0; !code && h < number; h++)
                for (Py_ssize_t k = 0; k < count; k++, at += 3)
                    *found++ = (int32_t)find_partner(&grid, of + 3 * k, facing + 3 * k, T + 16 * h, at);
            Py_END_ALLOW_THREADS
            answer = code ? failure(code) : Py_NewRef(Py_None);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *look(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *near, *far, *points, *normals, *poses, *sums, *answer = NULL;
    View view;
    double coarse, tolerance;
    if (!PyArg_ParseTuple(arguments, "OOdddOOOddO", &near, &far, &view.left, &view.top, &view.pitch, &points, &normals,
                          &poses, &coarse, &tolerance, &sums))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_buffer *nears, *fars, *out;
    Py_ssize_t count = -1, number = 0;
    const double *of, *facing, *T;
    if ((nears = array_argument(&arrays, near, "near", "d", 2, 0, -1, 0)) &&
        (fars = array_argument(&arrays, far, "far", "d", 2, 0, nears->shape[0], 0)) &&
        (of = triples(&arrays, points, "points", &count)) && (facing = triples(&arrays, normals, "normals", &count)) &&
        (T = poses_of(&arrays, poses, &number, 0)) && (out = array_argument(&arrays, sums, "sums", "d", 2, 0, number, 1))) {
        if (fars->shape[1] != nears->shape[1] || out->shape[1] != 4 || count < 1) {
            PyErr_SetString(PyExc_ValueError, "far, sums, points: another shape is needed");
        } else if (!(view.pitch > 0.0 && coarse > 0.0)) {
            PyErr_SetString(PyExc_ValueError, "pitch, coarse: must be positive");
        } else {
            view.near = nears->buf;
            view.far = fars->buf;
            view.h = nears->shape[0];
            view.w = nears->shape[1];
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = look_at_poses(&view, of, facing, count, T, number, coarse, tolerance, out->buf);
            Py_END_ALLOW_THREADS
            answer = code ? failure(code) : Py_NewRef(Py_None);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *find_normals(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *points, *places, *normals, *answer = NULL;
    int axis, neighbours;
    if (!PyArg_ParseTuple(arguments, "OOiiO", &points, &places, &axis, &neighbours, &normals))
        return NULL;
    Arrays arrays = {.count = 0};
    Py_ssize_t count = -1, asked = -1;
    const double *of, *at;
    Py_buffer *out;
    if ((of = triples(&arrays, points, "points", &count)) && (at = triples(&arrays, places, "places", &asked)) &&
        (out = array_argument(&arrays, normals, "normals", "d", 2, 0, asked, 1))) {
        if (out->shape[1] != 3) {
            PyErr_SetString(PyExc_ValueError, "normals: another shape is needed");
        } else if (axis < 0 || axis > 2 || neighbours < 1 || neighbours > count) {
            PyErr_SetString(PyExc_ValueError, "axis, neighbours: out of range");
        } else {
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = fit_normals(of, count, at, asked, axis, neighbours, out->buf);
            Py_END_ALLOW_THREADS
            answer = code ? failure(code) : Py_NewRef(Py_None);
        }
    }
    release(&arrays);
    return answer;
}

static PyMethodDef methods[] = {
    {"vote", vote, METH_VARARGS, "See voting.vote: fills `found`."},
    {"align", align, METH_VARARGS, "See alignment.align: changes `poses`."},
    {"partners", pair_up, METH_VARARGS, "See alignment.partners: fills `partner` and `place`."},
    {"look", look, METH_VARARGS, "See sight_check.look: adds to `sums`."},
    {"normals", find_normals, METH_VARARGS, "See scene_surface.normals_at: fills `normals`."},
    {NULL, NULL, 0, NULL},
};

static int execute(PyObject *module)
{
    return PyModule_AddIntConstant(module, "INTERFACE", INTERFACE);
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, (void *)execute}, {0, NULL}};

static struct PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "grasping.pose._kernels",
    .m_doc = "The compiled loops of the pose estimator.",
    .m_methods = methods,
    .m_slots = slots,
};

PyMODINIT_FUNC PyInit__kernels(void)
{
    return PyModuleDef_Init(&definition);
}
