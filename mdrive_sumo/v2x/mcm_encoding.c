/* Twins of mcm_encoding.py: the bytes of MCM. */
#include <math.h>

#include "encoding.h"

enum { FIXED_BYTES = 9, MOST_POINTS = 100, MOST_NAMES = 32, MOST_NAME_BYTES = 80, LAST_INTENTION = 3, LAST_DIRECTION = 5 };
enum { MOST_BYTES = FIXED_BYTES + 2 * (1 + 4 * MOST_POINTS) + 3 * (1 + MOST_NAMES * (2 + MOST_NAME_BYTES)) };
static const double CENTI = 100.0;
static Import MESSAGE_ERROR = {"mdrive_sumo.v2x.content", "MessageError", 0},
              PARTS = {"mdrive_sumo.v2x.mcm_encoding", "McmParts", 0};
FIELDS(NUMBERS, "speed", "interval_s");
FIELDS(CHOICES, "intention", "direction", "until_tick");
FIELDS(LISTS, "planned", "desired", "requests", "answers", "group");

/* A value of an enumeration from 0 on. */
static bool read_choice(PyObject *object, const char *name, int last, long long *choice) {
    double value = 0.0;
    bool is_number = object->ob_type != &PyUnicode_Type && read_number(object, &value);
    if (is_number && value >= 0.0 && value <= last && value == floor(value)) {
        *choice = (long long)value;
        return true;
    }
    PyErr_Clear();
    PyErr_Format(PyExc_ValueError, "%R is not a valid %s", object, name);
    return false;
}

static bool read_tick(PyObject *object, long long *tick) {
    Py_ssize_t value;
    if (!read_integer(object, &value)) {
        PyErr_Clear();
        return refuse_content("expected an until_tick that is a whole number");
    }
    if (value > UINT32_MAX) {
        PyObject *error = find_import(&MESSAGE_ERROR);
        if (error) PyErr_Format(error, "expected an until_tick up to 4294967295, found %zd", value);
        return false;
    }
    *tick = value < 0 ? 0 : value;
    return true;
}

static bool read_interval(PyObject *mcm, double interval_s, long long *interval) {
    if (!round_and_clamp(interval_s * CENTI, 15, -INFINITY, interval)) return false;
    if (*interval >= 1 && *interval <= 255) return true;
    PyObject *found = get_field(mcm, &NUMBERS, 1), *error = found ? find_import(&MESSAGE_ERROR) : NULL;
    if (error) PyErr_Format(error, "expected interval_s in [0.01, 2.55] s, found %S", found);
    if (found) Py_DecRef(found);
    return false;
}

static bool write_fixed(PyObject *mcm, Writer *to) {
    double numbers[2]; /* speed, interval_s */
    long long speed, interval, intention, direction, until_tick;
    PyObject *choices[3] = {0};
    bool is_valid = read_fields(mcm, &NUMBERS, numbers) && read_interval(mcm, numbers[1], &interval);
    for (int i = 0; is_valid && i < 3; i++) is_valid = (choices[i] = get_field(mcm, &CHOICES, i)) != NULL;
    is_valid = is_valid && read_tick(choices[2], &until_tick) && round_and_clamp(numbers[0] * CENTI, 15, -INFINITY, &speed) &&
               read_choice(choices[0], "Intention", LAST_INTENTION, &intention) &&
               read_choice(choices[1], "Direction", LAST_DIRECTION, &direction);
    for (int i = 0; i < 3; i++)
        if (choices[i]) Py_DecRef(choices[i]);
    if (!is_valid) return false;
    write_16(to, speed), write_8(to, intention), write_8(to, direction), write_8(to, interval);
    write_32(to, until_tick);
    return true;
}

/* As _encode_points. */
static bool write_trajectory(PyObject *object, const Pose *pose, Writer *to) {
    Array xy;
    if (!open_array(object, 'd', &xy)) return false;
    Py_ssize_t points = xy.dimensions ? xy.shape[0] : 0;
    PyObject *error = find_import(&MESSAGE_ERROR);
    bool is_written = error && points <= MOST_POINTS && xy.count == 2 * points;
    if (is_written) {
        write_8(to, points);
        is_written = write_points(pose, &xy, to);
    } else if (error && points > MOST_POINTS) {
        PyErr_Format(error, "expected at most %d points, found %zd", (int)MOST_POINTS, points);
    } else if (error) {
        PyErr_Format(error, "expected points (K, 2), found %zd numbers", xy.count);
    }
    close_array(&xy);
    return is_written;
}

/* As _encode_names, of one name; the number of names and their lengths are checked before. */
static bool write_name(PyObject *name, long long value, Writer *to) {
    Py_ssize_t size;
    const char *text = PyUnicode_AsUTF8AndSize(name, &size);
    if (!text) return false;
    write_8(to, size), write_8(to, value);
    write_bytes(to, text, (size_t)size);
    return true;
}

static bool check_names(PyObject *const *names, Py_ssize_t count) {
    bool is_valid = count <= MOST_NAMES;
    for (Py_ssize_t i = 0; is_valid && i < count; i++) {
        Py_ssize_t size;
        if (!PyUnicode_AsUTF8AndSize(names[i], &size)) return false;
        is_valid = size >= 1 && size <= MOST_NAME_BYTES;
    }
    PyObject *error = is_valid ? NULL : find_import(&MESSAGE_ERROR);
    if (error)
        PyErr_Format(error, "expected at most %d names of 1 to %d bytes, found %zd", (int)MOST_NAMES,
                     (int)MOST_NAME_BYTES, count);
    return is_valid;
}

static bool write_items(PyObject *items, bool are_requests, Writer *to) {
    PyObject *names[MOST_NAMES];
    long long values[MOST_NAMES];
    Py_ssize_t count = PyList_Size(items);
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *item = PyList_GetItem(items, i), *value = PyTuple_GetItem(item, 1);
        long long number = value && !are_requests ? PyObject_IsTrue(value) : 0;
        if (!value || number < 0 || (are_requests && !read_choice(value, "Intention", LAST_INTENTION, &number)))
            return false;
        if (i < MOST_NAMES) names[i] = PyTuple_GetItem(item, 0), values[i] = number;
    }
    if (!check_names(names, count)) return false;
    write_8(to, count);
    for (Py_ssize_t i = 0; i < count; i++)
        if (!write_name(names[i], values[i], to)) return false;
    return true;
}

static bool write_mapping(PyObject *mapping, bool are_requests, Writer *to) {
    PyObject *items = PyMapping_Items(mapping);
    bool is_written = items && write_items(items, are_requests, to);
    if (items) Py_DecRef(items);
    return is_written;
}

/* The names of a group, each once. */
static bool write_group(PyObject *group, Writer *to) {
    PyObject *names = PyDict_New(), *items = NULL;
    Py_ssize_t count = PyObject_Size(group);
    bool is_written = names && count >= 0;
    for (Py_ssize_t i = 0; is_written && i < count; i++) {
        PyObject *name = PySequence_GetItem(group, i);
        is_written = name && !PyDict_SetItem(names, name, &_Py_FalseStruct);
        if (name) Py_DecRef(name);
    }
    is_written = is_written && (items = PyMapping_Items(names)) && write_items(items, false, to);
    if (names) Py_DecRef(names);
    if (items) Py_DecRef(items);
    return is_written;
}

static PyObject *v2x_mcm_encoding_encode_mcm(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    unsigned char bytes[MOST_BYTES];
    Writer to = {bytes};
    Pose pose;
    PyObject *lists[5] = {0};
    bool is_written = expect_arguments("encode_mcm", count, 2, 2) && read_pose(arguments[1], &pose) &&
                      write_fixed(arguments[0], &to);
    for (int i = 0; is_written && i < 5; i++) is_written = (lists[i] = get_field(arguments[0], &LISTS, i)) != NULL;
    is_written = is_written && write_trajectory(lists[0], &pose, &to) && write_trajectory(lists[1], &pose, &to) &&
                 write_mapping(lists[2], true, &to) && write_mapping(lists[3], false, &to) && write_group(lists[4], &to);
    for (int i = 0; i < 5; i++)
        if (lists[i]) Py_DecRef(lists[i]);
    return is_written ? PyBytes_FromStringAndSize((char *)bytes, to.next - bytes) : NULL;
}

/* What is left to read of a body. */
typedef struct {
    const unsigned char *next, *end;
} Reader;

/* As _take_bytes; NULL: bytes are missing. */
static const unsigned char *take_bytes(Reader *from, Py_ssize_t size) {
    const unsigned char *bytes = from->next;
    if (size > from->end - bytes) {
        refuse_content("bytes are missing");
        return NULL;
    }
    from->next += size;
    return bytes;
}

/* As _take_points. */
static PyObject *take_points(Reader *from) {
    const unsigned char *count = take_bytes(from, 1);
    if (!count) return NULL;
    if (*count > MOST_POINTS) {
        PyObject *error = find_import(&MESSAGE_ERROR);
        if (error) PyErr_Format(error, "expected at most %d points, found %d", (int)MOST_POINTS, (int)*count);
        return NULL;
    }
    const unsigned char *points = take_bytes(from, 4 * *count);
    return points ? PyBytes_FromStringAndSize((char *)points, 4 * *count) : NULL;
}

static bool take_name(Reader *from, int most, PyObject *value_by_name) {
    const unsigned char *head = take_bytes(from, 2);
    if (!head) return false;
    if (head[0] < 1 || head[0] > MOST_NAME_BYTES || head[1] > most) {
        PyObject *error = find_import(&MESSAGE_ERROR);
        if (error)
            PyErr_Format(error, "expected names of 1 to %d bytes with values from 0 to %d", (int)MOST_NAME_BYTES, most);
        return false;
    }
    const unsigned char *text = take_bytes(from, head[0]);
    PyObject *name = text ? PyUnicode_FromStringAndSize((char *)text, head[0]) : NULL; /* its error is a ValueError */
    PyObject *value = name ? PyLong_FromLongLong(head[1]) : NULL;
    bool is_taken = value && !PyDict_SetItem(value_by_name, name, value);
    if (name) Py_DecRef(name);
    if (value) Py_DecRef(value);
    return is_taken;
}

/* As _take_names. */
static PyObject *take_names(Reader *from, int most) {
    const unsigned char *count = take_bytes(from, 1);
    PyObject *value_by_name = count ? PyDict_New() : NULL;
    bool is_valid = value_by_name;
    for (int i = 0; is_valid && i < *count; i++) is_valid = take_name(from, most, value_by_name);
    if (is_valid && (PyObject_Size(value_by_name) < *count || *count > MOST_NAMES)) {
        PyObject *error = find_import(&MESSAGE_ERROR);
        if (error)
            PyErr_Format(error, "expected at most %d different names, found %d", (int)MOST_NAMES, (int)*count);
        is_valid = false;
    }
    if (is_valid || !value_by_name) return value_by_name;
    Py_DecRef(value_by_name);
    return NULL;
}

static PyObject *pack_fixed(const unsigned char *fixed) {
    return pack(5, PyLong_FromLongLong((int16_t)read_16(fixed)), PyLong_FromLongLong(fixed[2]),
                PyLong_FromLongLong(fixed[3]), PyLong_FromLongLong(fixed[4]), PyLong_FromLongLong(read_32(fixed + 5)));
}

static PyObject *take_parts(Reader *from, const unsigned char *fixed) {
    PyObject *parts[6] = {pack_fixed(fixed)};
    for (int i = 1; i < 3 && parts[i - 1]; i++) parts[i] = take_points(from);
    for (int i = 3; i < 6 && parts[i - 1]; i++) parts[i] = take_names(from, i == 3 ? LAST_INTENTION : i == 4 ? 1 : 0);
    if (parts[5] && from->next != from->end) {
        PyObject *error = find_import(&MESSAGE_ERROR);
        if (error) PyErr_Format(error, "%zd bytes too many", (Py_ssize_t)(from->end - from->next));
        Py_DecRef(parts[5]);
        parts[5] = NULL;
    }
    return pack(6, parts[0], parts[1], parts[2], parts[3], parts[4], parts[5]);
}

static PyObject *v2x_mcm_encoding_parse_mcm(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("parse_mcm", count, 1, 1)) return NULL;
    Py_ssize_t size = PyBytes_Size(arguments[0]);
    PyObject *error = find_import(&MESSAGE_ERROR), *type = find_import(&PARTS);
    if (size < 0 || !error || !type) return NULL;
    if (size < FIXED_BYTES) return PyErr_Format(error, "expected at least 9 bytes after the header, found %zd", size);
    const unsigned char *body = (unsigned char *)PyBytes_AsString(arguments[0]);
    if (body[2] > LAST_INTENTION || body[3] > LAST_DIRECTION || !body[4])
        return PyErr_Format(error, "expected an intention, a direction and an interval above 0, found (%d, %d, %d)",
                            (int)body[2], (int)body[3], (int)body[4]);
    PyObject *values = take_parts(&(Reader){body + FIXED_BYTES, body + size}, body);
    PyObject *parts = values ? PyObject_CallObject(type, values) : NULL;
    if (values) Py_DecRef(values);
    return parts;
}

Functions v2x_mcm_encoding = {
    FUNCTION(v2x_mcm_encoding_encode_mcm),
    FUNCTION(v2x_mcm_encoding_parse_mcm),
    END_OF_FUNCTIONS,
};
