#include "values.h"

#include <stdarg.h>
#include <string.h>

static Import NDARRAY = {"numpy", "ndarray", 0}, EMPTY = {"numpy", "empty", 0},
              AS_ARRAY = {"numpy", "asarray", 0};

PyObject *find_import(Import *import) {
    if (!import->object) {
        PyObject *module = PyImport_ImportModule(import->module);
        if (!module) return NULL;
        import->object = PyObject_GetAttrString(module, import->name);
        Py_DecRef(module);
    }
    return import->object;
}

bool expect_arguments(const char *function, Py_ssize_t found, Py_ssize_t least, Py_ssize_t most) {
    if (found >= least && found <= most) return true;
    PyErr_Format(PyExc_TypeError, "%s: expected %zd to %zd arguments, found %zd", function, least, most, found);
    return false;
}

bool read_number(PyObject *object, double *value) {
    *value = PyFloat_AsDouble(object);
    return *value != -1.0 || !PyErr_Occurred();
}

bool read_numbers(PyObject *const *objects, int count, double *values) {
    for (int i = 0; i < count; i++)
        if (!read_number(objects[i], values + i)) return false;
    return true;
}

bool read_integer(PyObject *object, Py_ssize_t *value) {
    *value = PyLong_AsSsize_t(object);
    return *value != -1 || !PyErr_Occurred();
}

PyObject *refuse_numbers(const char *function) {
    PyErr_Format(PyExc_ValueError, "%s: found NaN, infinity or a division by zero", function);
    return NULL;
}

bool is_dict(PyObject *object) {
    if (object->ob_type == &PyDict_Type || PyType_IsSubtype(object->ob_type, &PyDict_Type)) return true;
    PyErr_SetString(PyExc_TypeError, "expected a dict");
    return false;
}

static bool intern(Fields *fields) {
    for (int i = 0; i < fields->count; i++)
        if (!fields->names[i] && !(fields->names[i] = PyUnicode_InternFromString(fields->texts[i]))) return false;
    return true;
}

PyObject *get_field(PyObject *object, Fields *fields, int i) {
    return intern(fields) ? PyObject_GetAttr(object, fields->names[i]) : NULL;
}

bool read_fields(PyObject *object, Fields *fields, double *values) {
    if (!intern(fields)) return false;
    for (int i = 0; i < fields->count; i++) {
        PyObject *value = PyObject_GetAttr(object, fields->names[i]);
        if (!value) return false;
        bool is_number = read_number(value, values + i);
        Py_DecRef(value);
        if (!is_number) return false;
    }
    return true;
}

PyObject *build_instance(Import *type, Fields *fields, PyObject **values) {
    bool is_complete = true; /* no import while an error is set */
    for (int i = 0; i < fields->count; i++) is_complete &= values[i] != NULL;
    PyTypeObject *class = is_complete ? (PyTypeObject *)find_import(type) : NULL;
    PyObject *instance = class && intern(fields) ? PyType_GenericAlloc(class, 0) : NULL;
    for (int i = 0; i < fields->count; i++) {
        /* Not the class's own way to set: it is frozen. */
        if (instance && PyObject_GenericSetAttr(instance, fields->names[i], values[i])) {
            Py_DecRef(instance);
            instance = NULL;
        }
        if (values[i]) Py_DecRef(values[i]);
    }
    return instance;
}

PyObject *build_instance_of_numbers(Import *type, Fields *fields, const double *values) {
    PyObject *objects[MOST_FIELDS];
    for (int i = 0; i < fields->count; i++) objects[i] = PyFloat_FromDouble(values[i]);
    return build_instance(type, fields, objects);
}

PyObject *build_tuple(Py_ssize_t count, const double *values) {
    PyObject *tuple = PyTuple_New(count);
    for (Py_ssize_t i = 0; tuple && i < count; i++) {
        PyObject *value = PyFloat_FromDouble(values[i]);
        if (!value || PyTuple_SetItem(tuple, i, value)) {
            Py_DecRef(tuple);
            return NULL;
        }
    }
    return tuple;
}

PyObject *build_list(Py_ssize_t count, const double *values) {
    PyObject *list = PyList_New(count);
    for (Py_ssize_t i = 0; list && i < count; i++) {
        PyObject *value = PyFloat_FromDouble(values[i]);
        if (!value || PyList_SetItem(list, i, value)) {
            Py_DecRef(list);
            return NULL;
        }
    }
    return list;
}

PyObject *pack(Py_ssize_t count, ...) {
    va_list objects;
    va_start(objects, count);
    PyObject *tuple = PyTuple_New(count);
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *object = va_arg(objects, PyObject *);
        if (tuple && object) {
            PyTuple_SetItem(tuple, i, object);
        } else {
            if (object) Py_DecRef(object);
            if (tuple) Py_DecRef(tuple);
            tuple = NULL;
        }
    }
    va_end(objects);
    return tuple;
}

bool is_array(PyObject *object) {
    PyObject *type = find_import(&NDARRAY);
    return type && (object->ob_type == (PyTypeObject *)type || PyType_IsSubtype(object->ob_type, (PyTypeObject *)type));
}

static const char *name_type(char kind) {
    return kind == 'd' ? "float64" : kind == 'f' ? "float32" : kind == '?' ? "bool" : kind == 'B' ? "uint8" : "int64";
}

/* Whether an element has the wanted type, in the byte order of this machine, by NumPy's letter (`=` stands before it
   where the array begins anywhere, `>` where bytes are swapped); int64 is `l` or `q`, by platform. */
static bool is_of_kind(const Py_buffer *buffer, char kind) {
    const char *format = buffer->format ? buffer->format : "B";
    char found = format[*format == '='];
    if (found == '\0' || format[1 + (*format == '=')] != '\0') return false;
    return found == kind || (kind == 'l' && found == 'q');
}

static bool view(PyObject *object, char kind, Array *array) {
    if (PyObject_GetBuffer(object, &array->buffer, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT)) {
        PyErr_Clear();
        return false;
    }
    if (is_of_kind(&array->buffer, kind) && array->buffer.ndim <= MOST_DIMENSIONS) return true;
    PyBuffer_Release(&array->buffer);
    return false;
}

bool open_array(PyObject *object, char kind, Array *array) {
    array->array = NULL;
    if (!view(object, kind, array)) {
        PyObject *convert = find_import(&AS_ARRAY), *type = PyUnicode_FromString(name_type(kind));
        PyObject *order = PyUnicode_FromString("C");
        if (convert && type && order) array->array = PyObject_CallFunctionObjArgs(convert, object, type, order, NULL);
        if (type) Py_DecRef(type);
        if (order) Py_DecRef(order);
        if (!array->array) return false;
        if (!view(array->array, kind, array)) {
            Py_DecRef(array->array);
            PyErr_Format(PyExc_TypeError, "expected an array of %s with at most %d dimensions, found another object",
                         name_type(kind), (int)MOST_DIMENSIONS);
            return false;
        }
    }
    array->data = array->buffer.buf;
    array->dimensions = array->buffer.ndim;
    array->count = 1;
    for (int i = 0; i < array->dimensions; i++) array->count *= array->shape[i] = array->buffer.shape[i];
    return true;
}

bool open_doubles(PyObject *object, int dimensions, Array *array) {
    if (!open_array(object, 'd', array)) return false;
    if (array->dimensions == dimensions) return true;
    PyErr_Format(PyExc_ValueError, "expected an array of %d dimensions, found %d", dimensions, array->dimensions);
    close_array(array);
    return false;
}

void close_array(Array *array) {
    PyBuffer_Release(&array->buffer);
    if (array->array) Py_DecRef(array->array);
}

void close_arrays(int count, Array *const *arrays) {
    for (int i = 0; i < count; i++) close_array(arrays[i]);
}

PyObject *new_array(char kind, int dimensions, const Py_ssize_t *shape, void **data) {
    static Import types[] = {
        {"numpy", "bool_", 0}, {"numpy", "uint8", 0}, {"numpy", "int64", 0}, {"numpy", "float32", 0}};
    PyObject *empty = find_import(&EMPTY), *size = PyTuple_New(dimensions), *type = NULL; /* float64 by default */
    if (kind != 'd' && !(type = find_import(&types[kind == '?' ? 0 : kind == 'B' ? 1 : kind == 'f' ? 3 : 2]))) empty = NULL;
    for (int i = 0; size && i < dimensions; i++) PyTuple_SetItem(size, i, PyLong_FromSsize_t(shape[i]));
    PyObject *array = empty && size ? PyObject_CallFunctionObjArgs(empty, size, type, NULL) : NULL;
    if (size) Py_DecRef(size);
    Py_buffer buffer;
    if (!array || PyObject_GetBuffer(array, &buffer, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE)) {
        if (array) Py_DecRef(array);
        return NULL;
    }
    *data = buffer.buf; /* lives as long as the array */
    PyBuffer_Release(&buffer);
    return array;
}

PyObject *new_doubles(int dimensions, const Py_ssize_t *shape, double **data) {
    return new_array('d', dimensions, shape, (void **)data);
}

bool open_rows(PyObject *object, size_t size, Array *array) {
    array->array = NULL;
    if (PyObject_GetBuffer(object, &array->buffer, PyBUF_C_CONTIGUOUS)) return false;
    if (array->buffer.ndim != 1 || array->buffer.itemsize != (Py_ssize_t)size) {
        PyErr_Format(PyExc_TypeError, "expected rows of %zd bytes, found an array of %d dimensions with elements of %zd",
                     (Py_ssize_t)size, array->buffer.ndim, array->buffer.itemsize);
        PyBuffer_Release(&array->buffer);
        return false;
    }
    array->data = array->buffer.buf;
    array->dimensions = 1;
    array->count = array->shape[0] = array->buffer.shape[0];
    return true;
}

PyObject *new_rows(Import *type, Py_ssize_t count, size_t size, void **data) {
    PyObject *empty = find_import(&EMPTY), *rows = find_import(type), *length = PyLong_FromSsize_t(count);
    PyObject *array = empty && rows && length ? PyObject_CallFunctionObjArgs(empty, length, rows, NULL) : NULL;
    if (length) Py_DecRef(length);
    Array view;
    if (!array || !open_rows(array, size, &view)) {
        if (array) Py_DecRef(array);
        return NULL;
    }
    *data = view.buffer.buf; /* lives as long as the array */
    close_array(&view);
    return array;
}
