/* Twin of collisions.py. */
#include <stdlib.h>

#include "../../core/compiled/values.h"
#include "../../core/geometry.h"

static const double SAME_PLACE_M = 3.0, FORGET_PLACE_M = 5.0;
enum { SAME_ACTOR_TICKS = 100 };

/* The memory of the original's collision sensor; the actor is borrowed, NULL if none. */
typedef struct {
    Point *places;
    Py_ssize_t place_count;
    PyObject *last_actor;
    Py_ssize_t last_tick;
} Memory;

static double compute_distance(Point at, Point place) { return portable_hypot(at.x - place.x, at.y - place.y); }

/* Whether a contact is a new collision, which is remembered then. */
static bool remember(Memory *memory, PyObject *other, Py_ssize_t tick, Point at) {
    bool is_map = PyObject_Size(other) == 0;
    if (!is_map && memory->last_actor && PyUnicode_Compare(other, memory->last_actor) == 0) return false;
    for (Py_ssize_t i = 0; i < memory->place_count; i++)
        if (!(compute_distance(at, memory->places[i]) > SAME_PLACE_M)) return false; /* NaN too */
    memory->places[memory->place_count++] = at; /* at most one a contact */
    if (!is_map) memory->last_actor = other;
    memory->last_tick = tick;
    return true;
}

static void forget_distant_places(Memory *memory, Point at) {
    Py_ssize_t kept = 0;
    for (Py_ssize_t i = 0; i < memory->place_count; i++)
        if (compute_distance(at, memory->places[i]) <= FORGET_PLACE_M) memory->places[kept++] = memory->places[i];
    memory->place_count = kept;
}

/* Adds the numbers of new collisions to a list; false with Python's error set. */
static bool find_new(const Array *xy, PyObject *ticks, PyObject *others, Memory *memory, PyObject *numbers) {
    Py_ssize_t next = 0, contacts = PyList_Size(ticks);
    for (Py_ssize_t tick = 0; tick < xy->shape[0]; tick++) {
        Point at = ((const Point *)xy->data)[tick];
        if (tick - memory->last_tick > SAME_ACTOR_TICKS) memory->last_actor = NULL;
        for (Py_ssize_t found; next < contacts; next++) {
            if (!read_integer(PyList_GetItem(ticks, next), &found)) return false;
            if (found > tick) break;
            if (found < tick || !remember(memory, PyList_GetItem(others, next), tick, at)) continue;
            PyObject *number = PyLong_FromSsize_t(next);
            bool is_added = number && !PyList_Append(numbers, number);
            if (number) Py_DecRef(number);
            if (!is_added) return false;
        }
        forget_distant_places(memory, at);
    }
    return !PyErr_Occurred();
}

static PyObject *scoring_metrics_collisions_find_new_contacts(PyObject *module, PyObject *const *arguments,
                                                              Py_ssize_t count) {
    Array xy;
    if (!expect_arguments("find_new_contacts", count, 3, 3)) return NULL;
    Py_ssize_t contacts = PyList_Size(arguments[1]);
    if (contacts < 0 || PyList_Size(arguments[2]) != contacts) {
        if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected as many others as ticks");
        return NULL;
    }
    if (!open_doubles(arguments[0], 2, &xy)) return NULL;
    Memory memory = {malloc((contacts + 1) * sizeof(Point)), 0, NULL, 0};
    PyObject *numbers = PyList_New(0);
    if (!memory.places) PyErr_NoMemory();
    if (xy.shape[1] != 2) PyErr_SetString(PyExc_ValueError, "expected places (n, 2)");
    bool is_done = numbers && memory.places && xy.shape[1] == 2 && find_new(&xy, arguments[1], arguments[2], &memory, numbers);
    free(memory.places);
    close_array(&xy);
    if (!is_done && numbers) Py_DecRef(numbers);
    return is_done ? numbers : NULL;
}

Functions scoring_metrics_collisions = {
    FUNCTION(scoring_metrics_collisions_find_new_contacts),
    END_OF_FUNCTIONS,
};
