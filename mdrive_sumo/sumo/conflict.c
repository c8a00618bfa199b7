/* Twins of conflict.py. */
#include "../core/compiled/values.h"
#include "../core/geometry.h"

FIELDS(POSES_FIELDS, "poses", "present", "dimensions");
FIELDS(MOVER_FIELDS, "x", "y", "yaw", "speed", "length", "width", "off_log");
enum { X, Y, YAW, SPEED, LENGTH, WIDTH, OFF_LOG, MOVER_COUNT };
enum { POSES, PRESENT, DIMENSIONS, ARRAY_COUNT };
enum { PREDICTION_COUNT = 21, PREDICTION_STEP = 3, ACCELERATIONS = 3 };
static const double DT = 1.0 / 20, MARGIN_M = 0.1, SEARCH_MARGIN_M = 20.0;
static const double ACCELERATION[ACCELERATIONS] = {0.0, -3.0, 2.0};

/* The mover's box in each tick ahead, for each acceleration. */
typedef struct {
    Box boxes[ACCELERATIONS][PREDICTION_COUNT];
} Motion;

static void extrapolate(const double *mover, Motion *motion) {
    CosSin direction = cos_sin(mover[YAW]);
    for (int k = 0; k < ACCELERATIONS; k++)
        for (int j = 0; j < PREDICTION_COUNT; j++) {
            double a = ACCELERATION[k], time = j * PREDICTION_STEP * DT;
            double stops = (mover[SPEED] > 0.0 ? mover[SPEED] : 0.0) / -a;
            if (a < 0.0 && stops < time) time = stops;
            double ahead = mover[SPEED] * time + a * (time * time) / 2;
            double x = mover[X] + direction.cos * ahead, y = mover[Y] + direction.sin * ahead;
            motion->boxes[k][j] = list_corners(x, y, direction.cos, direction.sin, mover[LENGTH], mover[WIDTH]);
        }
}

typedef struct {
    const double *poses; /* (T, 4) */
    const char *present; /* (T,) */
    double length, width;
    Py_ssize_t ticks;
} Vehicle;

static bool is_near(const Vehicle *vehicle, Py_ssize_t tick, const double *mover) {
    const double *now = vehicle->poses + 4 * tick;
    double reach = SEARCH_MARGIN_M + (mover[SPEED] + fabs(now[3])) * ((PREDICTION_COUNT - 1) * PREDICTION_STEP) * DT;
    return portable_hypot(now[0] - mover[X], now[1] - mover[Y]) < reach;
}

/* Whether a vehicle meets the mover now, or whatever the mover does. False with Python's error: no direction. */
static bool is_in_conflict(const Vehicle *vehicle, Py_ssize_t tick, const Motion *motion, bool off_log) {
    bool meets[ACCELERATIONS] = {false}, meets_now = false;
    for (int j = 0; j < PREDICTION_COUNT; j++) {
        Py_ssize_t at = tick + j * PREDICTION_STEP;
        bool is_logged = at < vehicle->ticks;
        const double *pose = vehicle->poses + 4 * (is_logged ? at : vehicle->ticks - 1);
        if (!isfinite(pose[2])) return refuse_numbers("find_conflicts");
        if (!is_logged || !vehicle->present[at]) continue;
        Box box = box_corners(pose[0], pose[1], pose[2], vehicle->length, vehicle->width);
        for (int k = 0; k < ACCELERATIONS; k++)
            if (!meets[k] && boxes_overlap(&box, &motion->boxes[k][j])) meets[k] = true;
        if (j == 0) meets_now = meets[0];
    }
    return meets_now || (off_log ? meets[0] : meets[0] && meets[1] && meets[2]);
}

static void search(const Array *arrays, Py_ssize_t tick, const char *is_candidate, const double *mover, char *found) {
    Motion motion;
    bool is_extrapolated = false;
    Py_ssize_t ticks = arrays[POSES].shape[1];
    for (Py_ssize_t i = 0; i < arrays[POSES].shape[0]; i++) {
        const double *size = doubles(arrays + DIMENSIONS) + 2 * i;
        Vehicle vehicle = {doubles(arrays + POSES) + 4 * ticks * i, (const char *)arrays[PRESENT].data + ticks * i,
                           size[0] + 2 * MARGIN_M, size[1] + 2 * MARGIN_M, ticks};
        found[i] = false;
        if (!is_candidate[i] || !is_near(&vehicle, tick, mover)) continue;
        if (!is_extrapolated) {
            if (!isfinite(mover[YAW])) refuse_numbers("find_conflicts");
            extrapolate(mover, &motion);
            is_extrapolated = true;
        }
        found[i] = is_in_conflict(&vehicle, tick, &motion, mover[OFF_LOG] != 0.0);
    }
}

static bool open_poses(PyObject *poses, Array *arrays, int *opened) {
    for (*opened = 0; *opened < ARRAY_COUNT; ++*opened) {
        PyObject *array = get_field(poses, &POSES_FIELDS, *opened);
        bool is_open = array && open_array(array, *opened == PRESENT ? '?' : 'd', arrays + *opened);
        if (array) Py_DecRef(array);
        if (!is_open) return false;
    }
    const Py_ssize_t *shape = arrays[POSES].shape;
    if (arrays[POSES].dimensions == 3 && shape[2] == 4 && arrays[PRESENT].count == shape[0] * shape[1] &&
        arrays[DIMENSIONS].count == 2 * shape[0])
        return true;
    PyErr_SetString(PyExc_ValueError, "expected poses (V, T, 4), presence (V, T) and dimensions (V, 2)");
    return false;
}

static PyObject *sumo_conflict_find_conflicts(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("find_conflicts", count, 4, 4)) return NULL;
    Py_ssize_t tick;
    double mover[MOVER_COUNT];
    Array arrays[ARRAY_COUNT], candidates;
    if (!read_integer(arguments[1], &tick) || !read_fields(arguments[3], &MOVER_FIELDS, mover) ||
        !open_array(arguments[2], '?', &candidates))
        return NULL;
    int opened;
    bool is_valid = open_poses(arguments[0], arrays, &opened);
    if (is_valid && (tick < 0 || tick >= arrays[POSES].shape[1] || candidates.count != arrays[POSES].shape[0])) {
        PyErr_SetString(PyExc_ValueError, "expected a tick of the poses, and a candidate for each vehicle");
        is_valid = false;
    }
    void *found;
    PyObject *result = is_valid ? new_array('?', 1, arrays[POSES].shape, &found) : NULL;
    if (result) search(arrays, tick, candidates.data, mover, found);
    for (int i = 0; i < opened; i++) close_array(arrays + i);
    close_array(&candidates);
    if (result && PyErr_Occurred()) {
        Py_DecRef(result);
        return NULL;
    }
    return result;
}

Functions sumo_conflict = {FUNCTION(sumo_conflict_find_conflicts), END_OF_FUNCTIONS};
