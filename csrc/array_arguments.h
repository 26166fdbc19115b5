/* Arrays as arguments of the compiled modules: sizes and types are checked here, so that the kernels can trust them.
 * They come in through the buffer protocol: no header of NumPy is needed, and none of its versions preferred. */
#ifndef ARRAY_ARGUMENTS_H
#define ARRAY_ARGUMENTS_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <string.h>

#define MOST_ARRAYS 24

/* The arrays that one call has taken and must release. */
typedef struct {
    Py_buffer views[MOST_ARRAYS];
    int count;
} Arrays;

static inline void release(Arrays *arrays)
{
    while (arrays->count > 0)
        PyBuffer_Release(&arrays->views[--arrays->count]);
}

/* A contiguous array of `ndim` dimensions, `axis` of this length unless that is −1; NULL with an error if not.
 * formats: the types that it may have, each a letter of Python's struct. ? and B are of 1 byte, f of 4, and
 * so are whole numbers if i comes first; all others here are of 8. */
static inline Py_buffer *array_argument(Arrays *arrays, PyObject *from, const char *name, const char *formats, int ndim,
                                        int axis, Py_ssize_t length, int writable)
{
    Py_buffer *view = &arrays->views[arrays->count];
    if (PyObject_GetBuffer(from, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0)) < 0)
        return NULL;
    arrays->count++;
    if (!view->format || strlen(view->format) != 1 || !strchr(formats, view->format[0]) ||
        view->itemsize != (strchr("?B", view->format[0]) ? 1 : view->format[0] == 'f' || formats[0] == 'i' ? 4 : 8))
        PyErr_Format(PyExc_TypeError, "%s: items of another type", name);
    else if (view->ndim != ndim || (length >= 0 && view->shape[axis] != length))
        PyErr_Format(PyExc_ValueError, "%s: another shape is needed", name);
    else
        return view;
    return NULL;
}

/* The end of a module whose functions are `methods`; it says which INTERFACE it has. */
#define KERNEL_MODULE(name, doc)                                                                                       \
    static int execute(PyObject *module) { return PyModule_AddIntConstant(module, "INTERFACE", INTERFACE); }           \
                                                                                                                       \
    static PyModuleDef_Slot slots[] = {{Py_mod_exec, (void *)execute}, {0, NULL}};                                     \
                                                                                                                       \
    static struct PyModuleDef definition = {                                                                           \
        .m_base = PyModuleDef_HEAD_INIT, .m_name = name, .m_doc = doc, .m_methods = methods, .m_slots = slots};        \
                                                                                                                       \
    PyMODINIT_FUNC PyInit__kernels(void) { return PyModuleDef_Init(&definition); }

#endif
