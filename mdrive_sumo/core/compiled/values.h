/* What twins share: numbers, fields, arrays and results, between Python's objects and C.

   Functions that return bool or a pointer return false or NULL with Python's error set. */
#ifndef MDRIVE_VALUES_H
#define MDRIVE_VALUES_H

#include <stdbool.h>
#include <stdint.h>

#include "python_abi.h"

/* The functions of one file, ended by an empty row. */
typedef PyMethodDef Functions[];
#define FUNCTION(function) {#function, function, METH_FASTCALL, 0}
#define END_OF_FUNCTIONS {0, 0, 0, 0}

/* An object of a Python module, found when it is first needed: that module imports this layer. */
typedef struct {
    const char *module, *name;
    PyObject *object;
} Import;
PyObject *find_import(Import *import); /* borrowed */

/* Names of fields, interned when they are first needed. */
enum { MOST_FIELDS = 32 };
typedef struct {
    int count;
    const char *const *texts;
    PyObject *names[MOST_FIELDS];
} Fields;
#define FIELDS(variable, ...)                                    \
    static const char *const variable##_texts[] = {__VA_ARGS__}; \
    static Fields variable = {sizeof variable##_texts / sizeof *variable##_texts, variable##_texts, {0}}

bool expect_arguments(const char *function, Py_ssize_t found, Py_ssize_t least, Py_ssize_t most);
bool read_number(PyObject *object, double *value);
bool read_numbers(PyObject *const *objects, int count, double *values);
bool read_integer(PyObject *object, Py_ssize_t *value);
/* Whether an object is a dict, for PyDict_Next; an error if not. */
bool is_dict(PyObject *object);
/* All fields as numbers, values[fields->count]. */
bool read_fields(PyObject *object, Fields *fields, double *values);
/* Field i as an object; a new reference. */
PyObject *get_field(PyObject *object, Fields *fields, int i);

/* As Python divides: by zero is refused. */
static inline double divide(double dividend, double divisor, bool *is_refused) {
    if (divisor == 0.0) *is_refused = true;
    return dividend / divisor;
}
PyObject *refuse_numbers(const char *function); /* ValueError: it cannot compute with its arguments */

/* An instance of a frozen dataclass with slots, whose fields are these; `values` are taken, also in an error. */
PyObject *build_instance(Import *type, Fields *fields, PyObject **values);
PyObject *build_instance_of_numbers(Import *type, Fields *fields, const double *values);
PyObject *build_tuple(Py_ssize_t count, const double *values);
PyObject *build_list(Py_ssize_t count, const double *values);
/* A tuple of objects that are taken, also in an error: NULL among them is an error. */
PyObject *pack(Py_ssize_t count, ...);

/* An array as C reads it: contiguous, in the order of C. Others are copied. */
enum { MOST_DIMENSIONS = 6 };
typedef struct {
    Py_buffer buffer;
    PyObject *array;
    const void *data;
    Py_ssize_t count; /* of elements */
    int dimensions;
    Py_ssize_t shape[MOST_DIMENSIONS];
} Array;
bool is_array(PyObject *object);
/* kind: 'd' float64, 'f' float32, '?' bool, 'l' int64 (and intp), 'B' uint8. Anything that NumPy makes an array of will do. */
bool open_array(PyObject *object, char kind, Array *array);
bool open_doubles(PyObject *object, int dimensions, Array *array);
void close_array(Array *array);
void close_arrays(int count, Array *const *arrays);
static inline const double *doubles(const Array *array) { return array->data; }

/* A new array whose elements have to be written to *data before anybody sees it. */
PyObject *new_array(char kind, int dimensions, const Py_ssize_t *shape, void **data);
PyObject *new_doubles(int dimensions, const Py_ssize_t *shape, double **data);

/* An array (N,) of a structured type, whose elements are structs of this size; `type` of new ones is a numpy.dtype. */
bool open_rows(PyObject *object, size_t size, Array *array);
PyObject *new_rows(Import *type, Py_ssize_t count, size_t size, void **data);

#endif
