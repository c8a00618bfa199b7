/* Twins of frozen.py. */
#include "compiled/values.h"

FIELDS(NAMES, "__match_args__");

static PyObject *core_frozen_build_frozen(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("build_frozen", count, 1, PTRDIFF_MAX)) return NULL;
    if (!PyType_IsSubtype(arguments[0]->ob_type, &PyType_Type)) {
        PyErr_SetString(PyExc_TypeError, "expected a class");
        return NULL;
    }
    PyObject *names = get_field(arguments[0], &NAMES, 0), *instance = NULL;
    Py_ssize_t fields = names ? PyTuple_Size(names) : -1;
    if (fields >= 0 && fields != count - 1)
        PyErr_Format(PyExc_TypeError, "expected %zd values, found %zd", fields, count - 1);
    else if (fields >= 0) instance = PyType_GenericAlloc((PyTypeObject *)arguments[0], 0);
    for (Py_ssize_t i = 0; instance && i < fields; i++)
        if (PyObject_GenericSetAttr(instance, PyTuple_GetItem(names, i), arguments[i + 1])) {
            Py_DecRef(instance);
            instance = NULL;
        }
    if (names) Py_DecRef(names);
    return instance;
}

Functions core_frozen = {FUNCTION(core_frozen_build_frozen), END_OF_FUNCTIONS};
