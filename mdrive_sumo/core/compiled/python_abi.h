/* The part of Python's stable ABI (PEP 384, version 3.11) that the compiled layer uses.

   Declared here and not taken from Python.h: a bare machine has no headers of Python, and what the stable ABI promises
   does not change. https://docs.python.org/3/c-api/stable.html lists it. */
#ifndef MDRIVE_PYTHON_ABI_H
#define MDRIVE_PYTHON_ABI_H

#include <stddef.h>

typedef ptrdiff_t Py_ssize_t;
typedef struct PyTypeObject PyTypeObject;
typedef struct {
    Py_ssize_t ob_refcnt;
    PyTypeObject *ob_type;
} PyObject;

typedef struct {
    const char *ml_name;
    PyObject *(*ml_meth)(PyObject *module, PyObject *const *arguments, Py_ssize_t count);
    int ml_flags;
    const char *ml_doc;
} PyMethodDef;
enum { METH_FASTCALL = 0x0080, PYTHON_API_VERSION = 3 };

typedef struct {
    PyObject ob_base;
    PyObject *(*m_init)(void);
    Py_ssize_t m_index;
    PyObject *m_copy;
    const char *m_name;
    const char *m_doc;
    Py_ssize_t m_size;
    PyMethodDef *m_methods;
    void *m_slots, *m_traverse, *m_clear, *m_free;
} PyModuleDef;

typedef struct {
    void *buf;
    PyObject *obj;
    Py_ssize_t len, itemsize;
    int readonly, ndim;
    char *format;
    Py_ssize_t *shape, *strides, *suboffsets;
    void *internal;
} Py_buffer;
enum { PyBUF_WRITABLE = 0x0001, PyBUF_FORMAT = 0x0004, PyBUF_C_CONTIGUOUS = 0x0038 };

extern PyTypeObject PyFloat_Type, PyLong_Type, PyList_Type, PyTuple_Type, PyDict_Type, PyType_Type, PyUnicode_Type;
extern PyObject _Py_NoneStruct, _Py_TrueStruct, _Py_FalseStruct;
extern PyObject *PyExc_ValueError, *PyExc_TypeError, *PyExc_OverflowError, *PyExc_ZeroDivisionError, *PyExc_MemoryError;

void Py_IncRef(PyObject *);
void Py_DecRef(PyObject *);
int PyType_IsSubtype(PyTypeObject *, PyTypeObject *);
PyObject *PyType_GenericAlloc(PyTypeObject *, Py_ssize_t);

PyObject *PyErr_Occurred(void);
PyObject *PyErr_NoMemory(void);
void PyErr_Clear(void);
void PyErr_SetString(PyObject *type, const char *text);
PyObject *PyErr_Format(PyObject *type, const char *format, ...);

double PyFloat_AsDouble(PyObject *);
PyObject *PyFloat_FromDouble(double);
long long PyLong_AsLongLong(PyObject *);
Py_ssize_t PyLong_AsSsize_t(PyObject *);
unsigned long long PyLong_AsUnsignedLongLong(PyObject *);
PyObject *PyLong_FromSsize_t(Py_ssize_t);
PyObject *PyLong_FromLongLong(long long);
PyObject *PyBool_FromLong(long);

PyObject *PyUnicode_InternFromString(const char *);
PyObject *PyUnicode_FromString(const char *);
PyObject *PyUnicode_FromStringAndSize(const char *, Py_ssize_t);
PyObject *PyUnicode_FromFormat(const char *format, ...);
PyObject *PyUnicode_AsUTF8String(PyObject *);
const char *PyUnicode_AsUTF8AndSize(PyObject *, Py_ssize_t *);
int PyUnicode_Compare(PyObject *, PyObject *);
PyObject *PyBytes_FromStringAndSize(const char *, Py_ssize_t);
char *PyBytes_AsString(PyObject *);
Py_ssize_t PyBytes_Size(PyObject *);

PyObject *PyTuple_New(Py_ssize_t);
Py_ssize_t PyTuple_Size(PyObject *);
PyObject *PyTuple_GetItem(PyObject *, Py_ssize_t);            /* borrowed */
int PyTuple_SetItem(PyObject *, Py_ssize_t, PyObject *value); /* takes the value */
PyObject *PyList_New(Py_ssize_t);
Py_ssize_t PyList_Size(PyObject *);
PyObject *PyList_GetItem(PyObject *, Py_ssize_t);             /* borrowed */
int PyList_SetItem(PyObject *, Py_ssize_t, PyObject *value);  /* takes the value */
int PyList_Append(PyObject *, PyObject *);
PyObject *PyDict_New(void);
PyObject *PyDict_GetItemWithError(PyObject *, PyObject *key); /* borrowed */
int PyDict_SetItem(PyObject *, PyObject *key, PyObject *value);
int PyDict_DelItem(PyObject *, PyObject *key);
int PyDict_Next(PyObject *, Py_ssize_t *position, PyObject **key, PyObject **value);

PyObject *PyObject_GetAttr(PyObject *, PyObject *name);
PyObject *PyObject_GetAttrString(PyObject *, const char *name);
int PyObject_GenericSetAttr(PyObject *, PyObject *name, PyObject *value);
int PyObject_IsTrue(PyObject *);
Py_ssize_t PyObject_Size(PyObject *);
PyObject *PyObject_Str(PyObject *);
PyObject *PyObject_GetItem(PyObject *, PyObject *key);
PyObject *PySequence_GetItem(PyObject *, Py_ssize_t);
PyObject *PyMapping_Items(PyObject *);
PyObject *PyObject_CallFunctionObjArgs(PyObject *callable, ...); /* ends with NULL */
PyObject *PyObject_CallObject(PyObject *callable, PyObject *arguments);
int PyObject_GetBuffer(PyObject *, Py_buffer *, int flags);
void PyBuffer_Release(Py_buffer *);

PyObject *PyImport_ImportModule(const char *name);
PyObject *PyModule_Create2(PyModuleDef *, int version);
int PyModule_AddStringConstant(PyObject *module, const char *name, const char *value);

#define Py_None (&_Py_NoneStruct)

static inline PyObject *new_reference(PyObject *object) {
    Py_IncRef(object);
    return object;
}
#endif
