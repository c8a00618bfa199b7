/* Twin of static_object_tracker.py. */
#include <stdlib.h>
#include <string.h>

#include "../core/portable.h"
#include "../core/state.h"

/* A row of type STANDSTILL. */
typedef struct {
    int64_t kind, has_moved, first_tick, last_tick, count;
    double x, y, cos, sin, length, width;
} Standstill;
static Import STANDSTILL = {"mdrive_sumo.perception.static_object_tracker", "STANDSTILL", 0};

typedef struct {
    double max_offset_m, lost_ticks;
} TrackerParameters;
FIELDS(TRACKER_PARAMETERS, "max_offset_m", "lost_ticks");

/* The row of each object; new ones are added to the dictionary. */
static bool find_rows(PyObject *row_by_id, const RoadUsers *objects, Py_ssize_t *rows) {
    for (Py_ssize_t i = 0; i < objects->count; i++) {
        PyObject *name = PyTuple_GetItem(objects->ids, i), *row = PyDict_GetItemWithError(row_by_id, name);
        if (row) {
            if (!read_integer(row, rows + i)) return false;
            continue;
        }
        rows[i] = PyObject_Size(row_by_id);
        row = PyErr_Occurred() ? NULL : PyLong_FromSsize_t(rows[i]);
        bool is_added = row && !PyDict_SetItem(row_by_id, name, row);
        if (row) Py_DecRef(row);
        if (!is_added) return false;
    }
    return true;
}

static void add_detection(Standstill *row, Py_ssize_t tick, int64_t kind, const Standstill *box,
                          const TrackerParameters *parameters) {
    double count = (double)row->count;
    if (row->count &&
        portable_hypot(row->x / count - box->x, row->y / count - box->y) > parameters->max_offset_m)
        row->has_moved = 1, row->count = 0;
    if (!row->count || (double)(tick - row->last_tick) > parameters->lost_ticks)
        *row = (Standstill){.kind = kind, .has_moved = row->has_moved, .first_tick = tick};
    row->x += box->x, row->y += box->y, row->cos += box->cos, row->sin += box->sin;
    row->length += box->length, row->width += box->width;
    row->last_tick = tick;
    row->count++;
}

static PyObject *add_detections(const Array *before, PyObject *row_by_id, Py_ssize_t tick, const RoadUsers *objects,
                                const TrackerParameters *parameters, Py_ssize_t *rows) {
    if (!find_rows(row_by_id, objects, rows)) return NULL;
    Py_ssize_t count = PyObject_Size(row_by_id);
    bool is_valid = count >= before->count;
    for (Py_ssize_t i = 0; i < objects->count; i++) is_valid &= rows[i] >= 0 && rows[i] < count;
    if (!is_valid) {
        PyErr_SetString(PyExc_ValueError, "expected a row for each id");
        return NULL;
    }
    void *data;
    PyObject *result = new_rows(&STANDSTILL, count, sizeof(Standstill), &data);
    if (!result) return NULL;
    if (count) memset(data, 0, (size_t)count * sizeof(Standstill));
    if (before->count) memcpy(data, before->data, (size_t)before->count * sizeof(Standstill));
    for (Py_ssize_t i = 0; i < objects->count; i++) {
        CosSin direction = cos_sin(yaws_of(objects)[i]);
        if (!isfinite(direction.cos)) {
            PyErr_SetString(PyExc_ValueError, "expected objects with finite headings, found NaN or infinity");
            Py_DecRef(result);
            return NULL;
        }
        Standstill box = {.x = x_of(objects)[i],
                          .y = y_of(objects)[i],
                          .cos = direction.cos,
                          .sin = direction.sin,
                          .length = lengths_of(objects)[i],
                          .width = widths_of(objects)[i]};
        add_detection((Standstill *)data + rows[i], tick, kinds_of(objects)[i], &box, parameters);
    }
    return result;
}

static PyObject *perception_static_object_tracker_add_detections(PyObject *module, PyObject *const *arguments,
                                                                 Py_ssize_t count) {
    Array before;
    RoadUsers objects;
    TrackerParameters parameters;
    Py_ssize_t tick;
    if (!expect_arguments("add_detections", count, 5, 5) || !read_integer(arguments[2], &tick) ||
        !read_fields(arguments[4], &TRACKER_PARAMETERS, &parameters.max_offset_m) ||
        !open_rows(arguments[0], sizeof(Standstill), &before))
        return NULL;
    PyObject *result = NULL;
    if (open_road_users(arguments[3], &objects)) {
        Py_ssize_t *rows = malloc((size_t)(objects.count + 1) * sizeof *rows);
        if (rows) result = add_detections(&before, arguments[1], tick, &objects, &parameters, rows);
        else PyErr_NoMemory();
        free(rows);
        close_road_users(&objects);
    }
    close_array(&before);
    return result;
}

Functions perception_static_object_tracker = {
    FUNCTION(perception_static_object_tracker_add_detections),
    END_OF_FUNCTIONS,
};
