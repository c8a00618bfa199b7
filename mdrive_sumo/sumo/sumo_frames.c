/* Twins of sumo_frames.py. */
#include "../core/compiled/values.h"
#include "../core/portable.h"

static Import ACTORS = {"mdrive_sumo.core.state", "Actors", 0};
FIELDS(ACTOR_FIELDS, "ids", "kind", "x", "y", "yaw", "speed", "length", "width");
enum { IDS, KIND, X, Y, YAW, SPEED, LENGTH, WIDTH, FIELD_COUNT };

/* As the remainder of NumPy for a positive divisor. */
static double wrap_degrees(double angle) {
    double rest = fabs(angle) < 360.0 ? angle : fmod(angle, 360.0);
    return rest == 0.0 ? 0.0 : rest < 0.0 ? rest + 360.0 : rest;
}

static double convert_angle(double degrees) { return (wrap_degrees(270.0 - degrees) - 180.0) * (PI / 180.0); }

typedef struct {
    double *x, *y, *yaw, *speed;
} Columns;

static bool place_row(Py_ssize_t row, PyObject *position, PyObject *angle, PyObject *speed, double length,
                      const Columns *columns) {
    double front[2], degrees;
    PyObject *coordinates[2] = {PyTuple_GetItem(position, 0), PyTuple_GetItem(position, 1)};
    if (!coordinates[0] || !coordinates[1] || !read_numbers(coordinates, 2, front) || !read_number(angle, &degrees) ||
        !read_number(speed, columns->speed + row))
        return false;
    double yaw = columns->yaw[row] = convert_angle(degrees), half = length / 2;
    CosSin direction = cos_sin(yaw);
    columns->x[row] = front[0] - direction.cos * half;
    columns->y[row] = front[1] - direction.sin * half;
    return isfinite(yaw) || refuse_numbers("place_actors");
}

static bool place_rows(PyObject *const *lists, const Array *length, const Columns *columns) {
    for (int i = 0; i < 3; i++)
        if (PyList_Size(lists[i]) != length->count) {
            if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected a value for every actor");
            return false;
        }
    for (Py_ssize_t row = 0; row < length->count; row++)
        if (!place_row(row, PyList_GetItem(lists[0], row), PyList_GetItem(lists[1], row), PyList_GetItem(lists[2], row),
                       doubles(length)[row], columns))
            return false;
    return true;
}

static PyObject *sumo_sumo_frames_place_actors(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("place_actors", count, 4, 4)) return NULL;
    PyObject *fields[FIELD_COUNT] = {0}, *template = arguments[0];
    const int kept[] = {IDS, KIND, LENGTH, WIDTH}, placed[] = {X, Y, YAW, SPEED};
    double *columns[4];
    Array length;
    bool is_open = false, is_placed = true;
    for (int i = 0; is_placed && i < 4; i++) is_placed = (fields[kept[i]] = get_field(template, &ACTOR_FIELDS, kept[i]));
    if (is_placed) is_placed = is_open = open_doubles(fields[LENGTH], 1, &length);
    for (int i = 0; is_placed && i < 4; i++)
        is_placed = (fields[placed[i]] = new_doubles(1, length.shape, columns + i));
    if (is_placed)
        is_placed = place_rows(arguments + 1, &length, &(Columns){columns[0], columns[1], columns[2], columns[3]});
    if (is_open) close_array(&length);
    if (!is_placed)
        for (int i = 0; i < FIELD_COUNT; i++)
            if (fields[i]) Py_DecRef(fields[i]);
    return is_placed ? build_instance(&ACTORS, &ACTOR_FIELDS, fields) : NULL;
}

Functions sumo_sumo_frames = {FUNCTION(sumo_sumo_frames_place_actors), END_OF_FUNCTIONS};
