/* The Python side of the compiled kernels. */
#include "array_arguments.h"
#include "planner.h"

/* Raised whenever a function here takes or returns something else; compiled_backend.py names the one that it knows. */
#define INTERFACE 9

/* A contiguous array of `ndim` dimensions, the first of this length unless that is −1; NULL with an error if not. */
static Py_buffer *array(Arrays *arrays, PyObject *from, const char *name, const char *formats, int ndim,
                        Py_ssize_t first, int writable)
{
    return array_argument(arrays, from, name, formats, ndim, 0, first, writable);
}

static const double *numbers(Arrays *arrays, PyObject *from, const char *name, Py_ssize_t *count)
{
    Py_buffer *view = array(arrays, from, name, "d", 1, *count, 0);
    if (!view)
        return NULL;
    *count = view->shape[0];
    return view->buf;
}

static int points(Arrays *arrays, PyObject *from, const char *name, Points *out)
{
    Py_buffer *view = array(arrays, from, name, "d", 2, 3, 0);
    if (!view)
        return 0;
    const double *data = view->buf;
    out->count = view->shape[1];
    out->x = data;
    out->y = data + out->count;
    out->height = data + 2 * out->count;
    return 1;
}

static int rows(Arrays *arrays, PyObject *from, const char *name, Rows *out)
{
    Py_buffer *view = array_argument(arrays, from, name, "d", 2, 1, 3, 0);
    if (!view)
        return 0;
    out->at = view->buf;
    out->count = view->shape[0];
    return 1;
}

static PyObject *failure(ptrdiff_t code)
{
    if (code == TOO_LARGE)
        return PyErr_Format(PyExc_ValueError, "the cloud is too large for a map at this resolution, or not finite");
    return PyErr_NoMemory();
}

/* A cloud of at least one point, and its axes. */
static int cloud_and_axes(Arrays *arrays, PyObject *cloud, PyObject *axes, Points *on, const double **turn)
{
    Py_buffer *view;
    if (!points(arrays, cloud, "cloud", on) || !(view = array(arrays, axes, "axes", "d", 2, 3, 0)))
        return 0;
    *turn = view->buf;
    if (on->count >= 1 && view->shape[1] == 3)
        return 1;
    PyErr_SetString(PyExc_ValueError, "cloud, axes: a point at least and three axes are needed");
    return 0;
}

static const double *three_axes(Arrays *arrays, PyObject *from)
{
    Py_buffer *view = array(arrays, from, "axes", "d", 2, 3, 0);
    if (view && view->shape[1] != 3)
        PyErr_SetString(PyExc_ValueError, "axes: three are needed");
    return view && view->shape[1] == 3 ? view->buf : NULL;
}

static PyObject *across(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *cloud, *axes, *answer = NULL;
    double cell, axis[2];
    if (!PyArg_ParseTuple(arguments, "OOd", &cloud, &axes, &cell))
        return NULL;
    Arrays arrays = {.count = 0};
    Points on;
    const double *turn;
    if (cloud_and_axes(&arrays, cloud, axes, &on, &turn)) {
        int code;
        Py_BEGIN_ALLOW_THREADS
        code = short_side(on, turn, cell, axis);
        Py_END_ALLOW_THREADS
        answer = code ? failure(code) : Py_BuildValue("dd", axis[0], axis[1]);
    }
    release(&arrays);
    return answer;
}

static PyObject *thin(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *cloud, *axes, *thinned, *answer = NULL;
    double box, depth;
    if (!PyArg_ParseTuple(arguments, "OOddO", &cloud, &axes, &box, &depth, &thinned))
        return NULL;
    Arrays arrays = {.count = 0};
    Points on;
    const double *turn;
    Py_buffer *out;
    if (cloud_and_axes(&arrays, cloud, axes, &on, &turn) && (out = array(&arrays, thinned, "thinned", "d", 2, 3, 1))) {
        if (out->shape[1] != on.count) {
            PyErr_SetString(PyExc_ValueError, "thinned: a column for each point is needed");
        } else {
            ptrdiff_t count;
            Py_BEGIN_ALLOW_THREADS
            count = thin_cloud(on, turn, box, depth, out->buf);
            Py_END_ALLOW_THREADS
            answer = count < 0 ? failure(count) : PyLong_FromSsize_t(count);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *place(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *cloud, *axes, *local, *answer = NULL;
    double table_height, cell, middle[3], footprint[4];
    if (!PyArg_ParseTuple(arguments, "OOddO", &cloud, &axes, &table_height, &cell, &local))
        return NULL;
    Arrays arrays = {.count = 0};
    Points on;
    const double *turn;
    Py_buffer *out;
    if (cloud_and_axes(&arrays, cloud, axes, &on, &turn) && (out = array(&arrays, local, "local", "d", 2, 3, 1))) {
        if (out->shape[1] != on.count) {
            PyErr_SetString(PyExc_ValueError, "local: a column for each point is needed");
        } else {
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = place_cloud(on, turn, table_height, cell, out->buf, middle, footprint);
            Py_END_ALLOW_THREADS
            answer = code ? failure(code)
                          : Py_BuildValue("ddddddd", middle[0], middle[1], middle[2], footprint[0], footprint[1],
                                          footprint[2], footprint[3]);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *scan(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *object, *others, *tips, *headings, *cosines, *sines, *holds;
    ScanSettings settings;
    if (!PyArg_ParseTuple(arguments, "OOOOOOddddddiiO", &object, &others, &tips, &headings, &cosines, &sines,
                          &settings.pad_width, &settings.wished_room, &settings.greatest_width, &settings.reach,
                          &settings.centre_x, &settings.centre_y, &settings.finger, &settings.wished, &holds))
        return NULL;
    if (!(settings.pad_width > 0.0) || settings.finger < 1 || settings.wished < settings.finger ||
        settings.wished > 1000000)
        return PyErr_Format(PyExc_ValueError, "pad_width, finger or wished is out of range");
    Arrays arrays = {.count = 0};
    Points on, around;
    Py_buffer *out;
    PyObject *answer = NULL;
    settings.tip_count = settings.heading_count = -1;
    if (points(&arrays, object, "object", &on) && points(&arrays, others, "others", &around) &&
        (settings.tips = numbers(&arrays, tips, "tips", &settings.tip_count)) &&
        (settings.headings = numbers(&arrays, headings, "headings", &settings.heading_count)) &&
        (settings.cosines = numbers(&arrays, cosines, "cosines", &settings.heading_count)) &&
        (settings.sines = numbers(&arrays, sines, "sines", &settings.heading_count)) &&
        (out = array(&arrays, holds, "holds", "d", 2, HOLD_TERMS, 1))) {
        if (out->shape[1] != MEASURED) {
            PyErr_Format(PyExc_ValueError, "holds: %d columns are needed", MEASURED);
        } else {
            ScanResult result;
            int code;
            Py_BEGIN_ALLOW_THREADS
            code = scan_holds(on, around, &settings, out->buf, &result);
            Py_END_ALLOW_THREADS
            answer = code ? failure(code) : Py_BuildValue("ndd", result.count, result.too_wide, result.narrowest);
        }
    }
    release(&arrays);
    return answer;
}

static int are_rules(const Rules *rules)
{
    const double tried = rules->refined + 2.0 * rules->slid + rules->candidates + rules->centred;
    return rules->pad_width > 0.0 && rules->refined >= 1.0 && rules->slid >= 0.0 && rules->centred >= 0.0 &&
           rules->candidates >= 0.0 && tried <= MOST_TRIED;
}

/* Depth images and what they are seen through. */
static int images(Arrays *arrays, PyObject *lenses, PyObject *depth, Sight *out)
{
    Py_buffer *through = array(arrays, lenses, "lenses", "d", 2, -1, 0), *drawn;
    if (!through || !(drawn = array(arrays, depth, "depth", "d", 3, through->shape[0], 0)))
        return 0;
    out->count = through->shape[0];
    out->lenses = through->buf;
    out->depth = drawn->buf;
    if (through->shape[1] == LENS && drawn->shape[1] == SIGHT_PIXELS && drawn->shape[2] == SIGHT_PIXELS)
        return 1;
    PyErr_Format(PyExc_ValueError, "lenses, depth: %d columns and %d pixels are needed", LENS, SIGHT_PIXELS);
    return 0;
}

static PyObject *look(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *cloud, *others, *unseen, *lens, *depth, *answer = NULL;
    double eye[3];
    if (!PyArg_ParseTuple(arguments, "OOOdddOO", &cloud, &others, &unseen, &eye[0], &eye[1], &eye[2], &lens, &depth))
        return NULL;
    Arrays arrays = {.count = 0};
    Points on;
    Rows around, ends;
    Py_buffer *through, *drawn;
    if (points(&arrays, cloud, "cloud", &on) && rows(&arrays, others, "others", &around) &&
        rows(&arrays, unseen, "unseen", &ends) && (through = array(&arrays, lens, "lens", "d", 1, LENS, 1)) &&
        (drawn = array(&arrays, depth, "depth", "d", 2, SIGHT_PIXELS, 1))) {
        if (drawn->shape[1] != SIGHT_PIXELS) {
            PyErr_Format(PyExc_ValueError, "depth: %d pixels are needed", SIGHT_PIXELS);
        } else {
            double share;
            Py_BEGIN_ALLOW_THREADS
            share = look_from(on, around, ends, eye, through->buf, drawn->buf);
            Py_END_ALLOW_THREADS
            answer = share < 0.0 ? failure(OUT_OF_MEMORY) : PyFloat_FromDouble(share);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *back(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *cloud, *viewpoints, *lenses, *depth, *found, *answer = NULL;
    double up[3], floor, cell;
    if (!PyArg_ParseTuple(arguments, "OdddddOOOO", &cloud, &up[0], &up[1], &up[2], &floor, &cell, &viewpoints, &lenses,
                          &depth, &found))
        return NULL;
    Arrays arrays = {.count = 0};
    Points on;
    Sight sight;
    Py_buffer *eyes, *out;
    if (points(&arrays, cloud, "cloud", &on) && images(&arrays, lenses, depth, &sight) &&
        (eyes = array(&arrays, viewpoints, "viewpoints", "d", 2, sight.count, 0)) &&
        (out = array(&arrays, found, "found", "d", 2, -1, 1))) {
        if (out->shape[1] != 3 || eyes->shape[1] != 3 || !(cell > 0.0) || on.count < 1 || sight.count < 1) {
            PyErr_SetString(PyExc_ValueError, "cloud, viewpoints, found, cell: points, three columns and a length are needed");
        } else {
            ptrdiff_t count;
            Py_BEGIN_ALLOW_THREADS
            count = assume_back(on, up, floor, cell, eyes->buf, &sight, out->buf, out->shape[0]);
            Py_END_ALLOW_THREADS
            answer = count < 0 ? failure(count) : PyLong_FromSsize_t(count);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *neighbours(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *others, *axes, *local, *answer = NULL;
    double middle[3], reach[2], cell;
    if (!PyArg_ParseTuple(arguments, "OOddddddO", &others, &axes, &middle[0], &middle[1], &middle[2], &reach[0], &reach[1],
                          &cell, &local))
        return NULL;
    Arrays arrays = {.count = 0};
    Rows around;
    const double *turn;
    Py_buffer *out;
    if (rows(&arrays, others, "others", &around) && (turn = three_axes(&arrays, axes)) &&
        (out = array(&arrays, local, "local", "d", 2, 3, 1))) {
        if (out->shape[1] != around.count) {
            PyErr_SetString(PyExc_ValueError, "local: a column for each of the others is needed");
        } else {
            ptrdiff_t count;
            Py_BEGIN_ALLOW_THREADS
            count = neighbours_of(around, turn, middle, reach, cell, out->buf);
            Py_END_ALLOW_THREADS
            answer = count < 0 ? failure(count) : PyLong_FromSsize_t(count);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *rank(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *object, *others, *lenses, *depth, *measured, *axes, *holds, *terms, *ranked, *problems;
    Py_ssize_t count, length = sizeof(Rules) / sizeof(double);
    double origin[3], centre_x, centre_y;
    if (!PyArg_ParseTuple(arguments, "OOOOOOdddOnddOOO", &object, &others, &lenses, &depth, &measured, &axes, &origin[0],
                          &origin[1], &origin[2], &holds, &count, &centre_x, &centre_y, &terms, &ranked, &problems))
        return NULL;
    Arrays arrays = {.count = 0};
    Points on, around, seen;
    Sight sight;
    Py_buffer *coarse, *out, *refusals;
    const double *numbered, *turn;
    PyObject *answer = NULL;
    if (points(&arrays, object, "object", &on) && points(&arrays, others, "others", &around) &&
        images(&arrays, lenses, depth, &sight) && points(&arrays, measured, "measured", &seen) && (turn = three_axes(&arrays, axes)) &&
        (coarse = array(&arrays, holds, "holds", "d", 2, HOLD_TERMS, 0)) &&
        (numbered = numbers(&arrays, terms, "rules", &length)) &&
        (out = array(&arrays, ranked, "ranked", "d", 2, RANKED_TERMS, 1)) &&
        (refusals = array(&arrays, problems, "problems", "lq", 1, MOST_TRIED, 1))) {
        const Py_ssize_t stride = coarse->shape[1];
        Rules rules;
        memcpy(&rules, numbered, sizeof(rules));
        if (out->shape[1] != MOST_TRIED || on.count < 1 || count < 1 || count > stride || count > MEASURED || !are_rules(&rules)) {
            PyErr_Format(PyExc_ValueError, "holds, rules or ranked: out of range");
        } else {
            ptrdiff_t found, refused;
            Py_BEGIN_ALLOW_THREADS
            found = rank_holds(on, around, &sight, seen, turn, origin, coarse->buf, stride, count, centre_x, centre_y,
                               &rules, out->buf, refusals->buf, &refused);
            Py_END_ALLOW_THREADS
            answer = found < 0 ? failure(found) : Py_BuildValue("nn", found, refused);
        }
    }
    release(&arrays);
    return answer;
}

static PyObject *survey(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *object, *hold_x, *hold_y, *order, *parts, *measures;
    double slab_height, flat;
    if (!PyArg_ParseTuple(arguments, "OOOddOOO", &object, &hold_x, &hold_y, &slab_height, &flat, &order, &parts,
                          &measures))
        return NULL;
    if (!(slab_height > 0.0))
        return PyErr_Format(PyExc_ValueError, "slab_height must be positive");
    Arrays arrays = {.count = 0};
    Points on;
    Py_buffer *orders, *table, *measured;
    Py_ssize_t count = -1;
    const double *xs, *ys;
    PyObject *answer = NULL;
    if (points(&arrays, object, "object", &on) && (xs = numbers(&arrays, hold_x, "hold_x", &count)) &&
        (ys = numbers(&arrays, hold_y, "hold_y", &count)) &&
        (orders = array(&arrays, order, "order", "lq", 1, on.count, 1)) &&
        (table = array(&arrays, parts, "parts", "lq", 2, on.count, 1)) &&
        (measured = array(&arrays, measures, "measures", "d", 2, on.count, 1))) {
        if (table->shape[1] != PART_COUNTS || measured->shape[1] != PART_MEASURES) {
            PyErr_Format(PyExc_ValueError, "parts, measures: %d and %d columns are needed", PART_COUNTS, PART_MEASURES);
        } else {
            ptrdiff_t found;
            Py_BEGIN_ALLOW_THREADS
            found = survey_regions(on, xs, ys, count, slab_height, flat, orders->buf, table->buf, measured->buf);
            Py_END_ALLOW_THREADS
            answer = found < 0 ? failure(found) : PyLong_FromSsize_t(found);
        }
    }
    release(&arrays);
    return answer;
}

static PyMethodDef methods[] = {
    {"short_side", across, METH_VARARGS, "See projection.short_side: returns the direction."},
    {"thin", thin, METH_VARARGS, "See projection.thin: fills `thinned`, returns the number of points."},
    {"place", place, METH_VARARGS, "See projection.place: fills `local`, returns the rest."},
    {"neighbours", neighbours, METH_VARARGS, "See projection.neighbours: fills `local`, returns the number of points."},
    {"look", look, METH_VARARGS, "See line_of_sight.look: fills `lens` and `depth`, returns the share that is hidden."},
    {"assume_back", back, METH_VARARGS, "See unseen_back.with_its_back: fills `found`, returns the number of places."},
    {"scan", scan, METH_VARARGS, "See finger_scan.scan: fills `holds`, returns (count, too_wide, narrowest)."},
    {"rank", rank, METH_VARARGS, "See ranking.rank: fills `ranked` or `problems`, returns the number of either."},
    {"survey", survey, METH_VARARGS, "See region_report.measure_regions: fills `order`, `parts` and `measures`, returns their number."},
    {NULL, NULL, 0, NULL},
};

KERNEL_MODULE("grasping.curvature_planner._kernels",
              "The compiled half of the planner's hot path. compiled_backend.py is its only caller.")
