/* Twin of objects_sensor.py: all detections of a sensor in a tick. */
#include <math.h>
#include <stdlib.h>

#include "../contract/sensors.h"
#include "../core/geometry.h"
#include "detection_noise.h"

enum { SECTORS = 72 };
static const double CAR_M[] = {4.5, 1.9};
FIELDS(DETECTOR, "profile", "is_exact", "sectors", "seed");
FIELDS(ANGLES, "half_fov", "yaw", "min_visible");
FIELDS(VIEW, "eye", "scene", "buildings", "range_m");
FIELDS(SCENE, "boxes", "tick");
FIELDS(ESTIMATE, "estimate");
FIELDS(POSE, "x", "y", "yaw");

typedef struct {
    DetectionProfile profile;
    ErrorDraws draws;
    bool is_exact;
    Py_ssize_t sectors;
    double half_fov, yaw, min_visible;
} Detector;

static bool read_field_integer(PyObject *object, Fields *fields, int i, Py_ssize_t *value) {
    PyObject *field = get_field(object, fields, i);
    bool is_read = field && read_integer(field, value);
    if (field) Py_DecRef(field);
    return is_read;
}

static bool read_detector(PyObject *object, Detector *detector) {
    Py_ssize_t is_exact, seed;
    double numbers[3];
    PyObject *profile = get_field(object, &DETECTOR, 0);
    bool is_read = profile && read_profile(profile, &detector->profile) &&
                   read_field_integer(object, &DETECTOR, 1, &is_exact) &&
                   read_field_integer(object, &DETECTOR, 2, &detector->sectors) &&
                   read_field_integer(object, &DETECTOR, 3, &seed) && read_fields(object, &ANGLES, numbers);
    if (profile) Py_DecRef(profile);
    if (!is_read) return false;
    detector->is_exact = is_exact;
    detector->draws = start_errors(seed);
    detector->half_fov = numbers[0], detector->yaw = numbers[1], detector->min_visible = numbers[2];
    return true;
}

/* A visibility.SightView, and where its carrier takes itself to be. */
typedef struct {
    Eye eye;
    bool has_estimate;
    double estimate[3];
    Py_ssize_t tick;
    RoadUsers boxes;
    Sight sight;
} View;

static bool read_estimate(PyObject *pose, View *view) {
    PyObject *estimate = get_field(pose, &ESTIMATE, 0);
    view->has_estimate = estimate != Py_None;
    bool is_read = estimate && (!view->has_estimate || read_fields(estimate, &POSE, view->estimate));
    if (estimate) Py_DecRef(estimate);
    return is_read;
}

static bool open_view(PyObject *object, View *view) {
    PyObject *fields[4] = {0}, *boxes = NULL;
    double range_m;
    bool is_open = true;
    for (int i = 0; is_open && i < 4; i++) is_open = (fields[i] = get_field(object, &VIEW, i)) != NULL;
    is_open = is_open && read_number(fields[3], &range_m) && read_eye(fields[0], &view->eye) &&
              read_estimate(fields[0], view) && read_field_integer(fields[1], &SCENE, 1, &view->tick) &&
              (boxes = get_field(fields[1], &SCENE, 0)) && open_road_users(boxes, &view->boxes);
    if (is_open && !open_sight(&view->boxes, view->eye, range_m, fields[2], &view->sight)) {
        close_road_users(&view->boxes);
        is_open = false;
    }
    for (int i = 0; i < 4; i++)
        if (fields[i]) Py_DecRef(fields[i]);
    if (boxes) Py_DecRef(boxes);
    return is_open;
}

static void close_view(View *view) {
    close_sight(&view->sight);
    close_road_users(&view->boxes);
}

static bool is_in_field(const Detector *detector, Eye eye, double x, double y, bool *is_in) {
    *is_in = detector->half_fov >= PI;
    if (*is_in) return true;
    double towards = portable_atan2(y - eye.y, x - eye.x);
    double bearing = wrap_half_open(towards - eye.yaw - detector->yaw);
    if (isnan(towards)) {
        PyErr_SetString(PyExc_ValueError, "expected finite places of boxes");
        return false;
    }
    *is_in = fabs(bearing) <= detector->half_fov;
    return true;
}

/* Makes a box that is visible in part a detection, or leaves it out. */
static bool detect_box(const Detector *detector, const View *view, Py_ssize_t row, double visible, Detection *seen,
                       bool *is_detected) {
    const RoadUsers *boxes = &view->boxes;
    Eye eye = view->eye;
    if (!is_in_field(detector, eye, x_of(boxes)[row], y_of(boxes)[row], is_detected)) return false;
    if (!*is_detected) return true;
    *seen = (Detection){.id = PyTuple_GetItem(boxes->ids, row), .kind = kinds_of(boxes)[row]};
    for (int i = 0; i < USER_COLUMNS; i++) seen->columns[i] = doubles(boxes->columns + i)[row];
    if (detector->is_exact) return true;
    const DetectionProfile *profile = &detector->profile;
    double distance = portable_hypot(seen->columns[0] - eye.x, seen->columns[1] - eye.y);
    double recall = compute_recall_at(profile, distance, visible < profile->min_visible ? profile->min_visible : visible);
    EpochTime time;
    return find_epoch(&detector->draws, seen->id, view->tick, &time) &&
           draw_detected(&detector->draws, seen->id, time, recall, is_detected) &&
           (!*is_detected || add_errors(profile, &detector->draws, time, eye, seen));
}

static bool detect_boxes(const Detector *detector, const View *view, Detection *seen, Py_ssize_t *count) {
    double *fractions = malloc((view->boxes.count + 1) * sizeof *fractions);
    if (!fractions) return PyErr_NoMemory(), false;
    bool is_valid = fill_visible_fractions(&view->sight, fractions);
    for (Py_ssize_t row = 0; is_valid && row < view->boxes.count; row++) {
        if (!(fractions[row] >= detector->min_visible && fractions[row] > 0.0)) continue;
        bool is_detected;
        is_valid = detect_box(detector, view, row, fractions[row], seen + *count, &is_detected);
        if (is_valid && is_detected) Py_IncRef(seen[(*count)++].id);
    }
    free(fractions);
    return is_valid;
}

/* Whether sight is free as far as a false positive, by the rays at both sides of it. */
static bool is_free(const Detector *detector, Eye eye, const double *free_m, const Detection *ghost, bool *result) {
    double x = ghost->columns[0] - eye.x, y = ghost->columns[1] - eye.y;
    double turned = fmod(portable_atan2(y, x) - eye.yaw, TAU);
    if (turned < 0.0) turned += TAU;
    if (isnan(turned)) {
        PyErr_SetString(PyExc_ValueError, "expected finite places of false positives");
        return false;
    }
    int between = (int)(turned / TAU * SECTORS) % SECTORS;
    double sight = free_m[between], after = free_m[(between + 1) % SECTORS];
    bool is_shown = portable_hypot(x, y) <= (after < sight ? after : sight);
    if (!is_in_field(detector, eye, ghost->columns[0], ghost->columns[1], result)) return false;
    *result = *result && is_shown;
    return true;
}

static bool read_ghost(PyObject *ghost, Detection *seen) {
    PyObject *values[4];
    for (int i = 0; i < 4; i++)
        if (!(values[i] = PyTuple_GetItem(ghost, 3 + i))) return false; /* id, x, y, yaw */
    *seen = (Detection){.id = values[0], .kind = VEHICLE, .columns = {[4] = CAR_M[0], [5] = CAR_M[1]}};
    return read_numbers(values + 1, 3, seen->columns);
}

static bool add_ghosts(const Detector *detector, const View *view, PyObject *ghosts, Detection *seen,
                       Py_ssize_t *count) {
    double free_m[SECTORS];
    if (!fill_free_sight(&view->sight, SECTORS, free_m)) return false;
    for (Py_ssize_t i = 0; i < PyList_Size(ghosts); i++) {
        bool is_shown;
        if (!read_ghost(PyList_GetItem(ghosts, i), seen + *count) ||
            !is_free(detector, view->eye, free_m, seen + *count, &is_shown))
            return false;
        if (is_shown) Py_IncRef(seen[(*count)++].id);
    }
    return true;
}

/* Insertion keeps the order of equal distances; what is not a number comes last, as in NumPy's order. */
static void sort_by_distance(const Detection *seen, Py_ssize_t count, Py_ssize_t *order) {
    for (Py_ssize_t i = 0; i < count; i++) {
        Py_ssize_t place = i;
        double distance = seen[i].distance;
        for (; place > 0; place--) {
            double before = seen[order[place - 1]].distance;
            if (!(distance < before) && !(isnan(before) && !isnan(distance))) break;
            order[place] = order[place - 1];
        }
        order[place] = i;
    }
}

/* As SensorPose.place_by_estimate, of one object. */
static void place_by_estimate(const View *view, CosSin turn, double *columns) {
    if (!view->has_estimate) return;
    double dx = columns[0] - view->eye.x, dy = columns[1] - view->eye.y;
    columns[0] = view->estimate[0] + turn.cos * dx - turn.sin * dy;
    columns[1] = view->estimate[1] + turn.sin * dx + turn.cos * dy;
    columns[2] = columns[2] + (view->estimate[2] - view->eye.yaw);
}

static bool fill_told(const View *view, Detection *seen, Py_ssize_t count, const Py_ssize_t *order, PyObject *names,
                      NewRoadUsers *told) {
    CosSin turn = cos_sin(view->has_estimate ? view->estimate[2] - view->eye.yaw : 0.0);
    if (isnan(turn.cos)) {
        PyErr_SetString(PyExc_ValueError, "expected a finite yaw");
        return false;
    }
    for (Py_ssize_t i = 0; i < count; i++) {
        Detection *one = seen + order[i];
        PyObject *name = PyObject_GetItem(names, one->id);
        if (!name || PyTuple_SetItem(told->ids, i, name)) return false;
        place_by_estimate(view, turn, one->columns);
        told->kinds[i] = one->kind;
        for (int k = 0; k < USER_COLUMNS; k++) told->values[k][i] = one->columns[k];
    }
    return true;
}

static PyObject *tell(const Detector *detector, const View *view, Detection *seen, Py_ssize_t count,
                      const Py_ssize_t *order, PyObject *names) {
    NewRoadUsers told;
    if (!new_road_users(count, &told)) return NULL;
    double *free_m;
    PyObject *free_sight = new_doubles(1, &detector->sectors, &free_m);
    if (!free_sight || !fill_told(view, seen, count, order, names, &told) ||
        (detector->sectors && !fill_free_sight(&view->sight, detector->sectors, free_m))) {
        if (free_sight) Py_DecRef(free_sight);
        drop_road_users(&told);
        return NULL;
    }
    return build_objects(&told, free_sight);
}

static PyObject *detect(const Detector *detector, const View *view, PyObject *ghosts, PyObject *names) {
    Py_ssize_t count = 0, most = view->boxes.count + PyList_Size(ghosts) + 1;
    Detection *seen = malloc(most * sizeof *seen);
    Py_ssize_t *order = malloc(most * sizeof *order);
    PyObject *result = NULL;
    if (!seen || !order) {
        PyErr_NoMemory();
    } else if (detect_boxes(detector, view, seen, &count) &&
               (!PyList_Size(ghosts) || add_ghosts(detector, view, ghosts, seen, &count))) {
        for (Py_ssize_t i = 0; i < count; i++)
            seen[i].distance = portable_hypot(seen[i].columns[0] - view->eye.x, seen[i].columns[1] - view->eye.y);
        sort_by_distance(seen, count, order);
        result = tell(detector, view, seen, count, order, names);
    }
    for (Py_ssize_t i = 0; i < count; i++) Py_DecRef(seen[i].id);
    free(seen);
    free(order);
    return result;
}

static PyObject *sensing_objects_sensor_detect(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Detector detector;
    View view;
    if (!expect_arguments("detect", count, 4, 4) || !read_detector(arguments[0], &detector)) return NULL;
    if (detector.sectors < 0 || PyList_Size(arguments[2]) < 0) {
        if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected a number of sectors that is not negative");
        return NULL;
    }
    if (!open_view(arguments[1], &view)) return NULL;
    PyObject *result = detect(&detector, &view, arguments[2], arguments[3]);
    close_view(&view);
    return result;
}

Functions sensing_objects_sensor = {
    FUNCTION(sensing_objects_sensor_detect),
    END_OF_FUNCTIONS,
};
