/* Twin of static_object_tracker.py. */
#include <string.h>

#include "../core/portable.h"
#include "../core/state.h"

/* A row of type STANDSTILL. */
typedef struct {
    int64_t kind, has_moved, first_tick, last_tick, count;
    double x, y, cos, sin, length, width;
} Standstill;
static Import STANDSTILL = {"mdrive_sumo.perception.static_object_tracker", "STANDSTILL", 0};

static const double DT = 1.0 / 20;

typedef struct {
    double max_offset_m, lost_ticks, recall_ticks;
} TrackerParameters;
FIELDS(TRACKER_PARAMETERS, "max_offset_m", "lost_ticks", "recall_ticks");

/* Before anything is stored: objects that are refused leave no trace. */
static bool check_yaws(const RoadUsers *objects) {
    for (Py_ssize_t i = 0; i < objects->count; i++)
        if (!isfinite(cos_sin(yaws_of(objects)[i]).cos)) {
            PyErr_SetString(PyExc_ValueError, "expected objects with finite headings, found NaN or infinity");
            return false;
        }
    return true;
}

/* The row of each object; new ones are added to the dictionary. */
static bool find_rows(PyObject *row_by_id, const RoadUsers *objects, int64_t *rows) {
    for (Py_ssize_t i = 0; i < objects->count; i++) {
        PyObject *name = PyTuple_GetItem(objects->ids, i), *row = PyDict_GetItemWithError(row_by_id, name);
        Py_ssize_t place = PyObject_Size(row_by_id);
        if (row ? !read_integer(row, &place) : !!PyErr_Occurred()) return false;
        rows[i] = place;
        if (row) continue;
        row = PyLong_FromSsize_t(place);
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

/* The standstills and the rows of objects, as arrays, and those arrays' memory. */
typedef struct {
    PyObject *standstills, *rows;
    Standstill *standstill;
    int64_t *row;
    Py_ssize_t count;
} Update;

static bool add_objects(const Update *update, Py_ssize_t tick, const RoadUsers *objects,
                        const TrackerParameters *parameters) {
    for (Py_ssize_t i = 0; i < objects->count; i++) {
        CosSin direction = cos_sin(yaws_of(objects)[i]);
        if (update->row[i] < 0 || update->row[i] >= update->count) {
            PyErr_SetString(PyExc_ValueError, "expected a row for each id");
            return false;
        }
        Standstill box = {.x = x_of(objects)[i],
                          .y = y_of(objects)[i],
                          .cos = direction.cos,
                          .sin = direction.sin,
                          .length = lengths_of(objects)[i],
                          .width = widths_of(objects)[i]};
        add_detection(update->standstill + update->row[i], tick, kinds_of(objects)[i], &box, parameters);
    }
    return true;
}

static bool is_missed(const Standstill *row, Py_ssize_t tick, double recall_s, const TrackerParameters *parameters) {
    int64_t missed_ticks = tick - row->last_tick;
    return row->kind == STATIC && (double)(row->last_tick - row->first_tick) * DT >= recall_s && missed_ticks > 0 &&
           (double)missed_ticks <= parameters->recall_ticks;
}

static PyObject *list_missed(const Update *update, Py_ssize_t tick, double recall_s,
                             const TrackerParameters *parameters) {
    Py_ssize_t count = 0;
    void *data;
    for (Py_ssize_t i = 0; i < update->count; i++)
        count += is_missed(update->standstill + i, tick, recall_s, parameters);
    PyObject *rows = new_array('l', 1, &count, &data);
    for (Py_ssize_t i = 0, next = 0; rows && next < count; i++)
        if (is_missed(update->standstill + i, tick, recall_s, parameters)) ((int64_t *)data)[next++] = i;
    return rows;
}

/* Room for all objects that the dictionary knows; those of `before` first. */
static bool begin_update(const Array *before, PyObject *row_by_id, const RoadUsers *objects, Update *update) {
    void *rows, *standstills;
    update->rows = new_array('l', 1, &objects->count, &rows);
    if (!update->rows) return false;
    update->row = rows;
    if (!check_yaws(objects) || !find_rows(row_by_id, objects, update->row)) return false;
    update->count = PyObject_Size(row_by_id);
    if (update->count < before->count) {
        PyErr_SetString(PyExc_ValueError, "expected an id for each row");
        return false;
    }
    update->standstills = new_rows(&STANDSTILL, update->count, sizeof(Standstill), &standstills);
    if (!update->standstills) return false;
    update->standstill = standstills;
    if (update->count) memset(standstills, 0, (size_t)update->count * sizeof(Standstill));
    if (before->count) memcpy(standstills, before->data, (size_t)before->count * sizeof(Standstill));
    return true;
}

static PyObject *perception_static_object_tracker_add_detections(PyObject *module, PyObject *const *arguments,
                                                                 Py_ssize_t count) {
    Array before;
    RoadUsers objects;
    TrackerParameters parameters;
    Py_ssize_t tick;
    double recall_s;
    if (!expect_arguments("add_detections", count, 6, 6) || !read_integer(arguments[2], &tick) ||
        !read_number(arguments[4], &recall_s) ||
        !read_fields(arguments[5], &TRACKER_PARAMETERS, &parameters.max_offset_m) ||
        !open_rows(arguments[0], sizeof(Standstill), &before))
        return NULL;
    Update update = {0};
    PyObject *missed = NULL;
    if (open_road_users(arguments[3], &objects)) {
        if (begin_update(&before, arguments[1], &objects, &update) && add_objects(&update, tick, &objects, &parameters))
            missed = list_missed(&update, tick, recall_s, &parameters);
        close_road_users(&objects);
    }
    close_array(&before);
    return pack(3, update.standstills, update.rows, missed);
}

Functions perception_static_object_tracker = {
    FUNCTION(perception_static_object_tracker_add_detections),
    END_OF_FUNCTIONS,
};
