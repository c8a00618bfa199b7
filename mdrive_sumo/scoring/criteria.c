/* Twins of criteria.py. */
#include "../core/compiled/values.h"
#include "../core/portable.h"

static Import PROGRESS = {"mdrive_sumo.scoring.criteria", "RouteProgress", 0};
FIELDS(PROGRESS_FIELDS, "passed", "arrived_tick", "nearest", "off_route_m", "has_deviated", "moving_tick");
FIELDS(REFERENCE_FIELDS, "x", "y", "cos", "sin", "s");
enum { PASSED, ARRIVED_TICK, NEAREST, OFF_ROUTE_M, HAS_DEVIATED, MOVING_TICK, PROGRESS_COUNT };
enum { X, Y, COS, SIN, S, COLUMN_COUNT };

enum { COMPLETION_WINDOW = 2, DEVIATION_WINDOW = 5 };
static const double COMPLETE_PERCENT = 99.0, GOAL_RADIUS_M = 10.0, DEVIATION_MAX_M = 30.0, DEVIATION_MIN_M = 15.0,
                    DEVIATION_SHARE = 0.30, BLOCKED_SPEED = 0.5;

typedef struct {
    PyObject *columns[COLUMN_COUNT];
    Py_ssize_t count; /* of points */
} Route;

static void close_route(Route *route) {
    for (int i = 0; i < COLUMN_COUNT; i++)
        if (route->columns[i]) Py_DecRef(route->columns[i]);
}

static bool open_route(PyObject *reference, Route *route) {
    *route = (Route){0};
    for (int i = 0; i < COLUMN_COUNT; i++) {
        PyObject *column = route->columns[i] = get_field(reference, &REFERENCE_FIELDS, i);
        Py_ssize_t count = column ? PyTuple_Size(column) : -1;
        if (i == 0) route->count = count;
        if (count < 1 || count != route->count) {
            if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected a route of points");
            close_route(route);
            return false;
        }
    }
    return true;
}

/* Where it is not a number Python's error is set. */
static double get(const Route *route, int column, Py_ssize_t point) {
    return PyFloat_AsDouble(PyTuple_GetItem(route->columns[column], point));
}

static Py_ssize_t pass_points(const Route *route, Py_ssize_t index, Py_ssize_t window, double x, double y) {
    Py_ssize_t end = window < route->count - index - 1 ? index + window + 1 : route->count;
    for (Py_ssize_t i = index + 1; i < end; i++) {
        double dx = x - get(route, X, i), dy = y - get(route, Y, i);
        if (dx * get(route, COS, i) + dy * get(route, SIN, i) > 0.0) index = i;
    }
    return index;
}

static bool is_complete(const Route *route, Py_ssize_t passed, double x, double y) {
    double length = get(route, S, route->count - 1);
    if (length == 0.0) return refuse_numbers("update_progress");
    if (100.0 * get(route, S, passed) / length <= COMPLETE_PERCENT) return false;
    double dx = x - get(route, X, route->count - 1), dy = y - get(route, Y, route->count - 1);
    return portable_hypot(dx, dy) < GOAL_RADIUS_M;
}

static Py_ssize_t find_nearest(const Route *route, Py_ssize_t index, double x, double y, double *least) {
    Py_ssize_t best = index, end = index + DEVIATION_WINDOW + 1;
    *least = INFINITY;
    for (Py_ssize_t i = index; i < end && i < route->count; i++) {
        double dx = x - get(route, X, i), dy = y - get(route, Y, i), square = dx * dx + dy * dy;
        if (square <= *least) best = i, *least = square;
    }
    return best;
}

static PyObject *scoring_criteria_advance_index(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("advance_index", count, 5, 5)) return NULL;
    Py_ssize_t index, window;
    double place[2];
    Route route;
    if (!read_integer(arguments[1], &index) || !read_integer(arguments[2], &window) ||
        !read_numbers(arguments + 3, 2, place) || !open_route(arguments[0], &route))
        return NULL;
    if (index < 0 || index >= route.count || window < 0) PyErr_SetString(PyExc_ValueError, "expected a point of the route");
    else index = pass_points(&route, index, window, place[0], place[1]);
    close_route(&route);
    return PyErr_Occurred() ? NULL : PyLong_FromSsize_t(index);
}

typedef struct {
    Py_ssize_t passed, nearest;
    double off_route_m;
    bool has_arrived, has_deviated;
} Progress;

static void advance_progress(Progress *progress, const Route *route, double x, double y) {
    if (!progress->has_arrived) {
        progress->passed = pass_points(route, progress->passed, COMPLETION_WINDOW, x, y);
        progress->has_arrived = is_complete(route, progress->passed, x, y);
    }
    double square;
    Py_ssize_t step = find_nearest(route, progress->nearest, x, y, &square);
    bool is_off = DEVIATION_MIN_M * DEVIATION_MIN_M <= square && square < DEVIATION_MAX_M * DEVIATION_MAX_M;
    if (is_off && step > progress->nearest) {
        progress->off_route_m += get(route, S, step) - get(route, S, progress->nearest);
        progress->has_deviated |= progress->off_route_m > DEVIATION_SHARE * get(route, S, route->count - 1);
    }
    progress->has_deviated |= square >= DEVIATION_MAX_M * DEVIATION_MAX_M;
    progress->nearest = step;
}

static PyObject *scoring_criteria_update_progress(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("update_progress", count, 6, 6)) return NULL;
    PyObject *fields[PROGRESS_COUNT] = {0}, *tick = arguments[2], *result = NULL;
    double motion[3];
    Route route;
    if (!read_numbers(arguments + 3, 3, motion) || !open_route(arguments[1], &route)) return NULL;
    for (int i = 0; i < PROGRESS_COUNT; i++)
        if (!(fields[i] = get_field(arguments[0], &PROGRESS_FIELDS, i))) goto done;
    Progress progress = {.has_arrived = fields[ARRIVED_TICK] != Py_None,
                         .has_deviated = PyObject_IsTrue(fields[HAS_DEVIATED]) == 1};
    if (!read_integer(fields[PASSED], &progress.passed) || !read_integer(fields[NEAREST], &progress.nearest) ||
        !read_number(fields[OFF_ROUTE_M], &progress.off_route_m))
        goto done;
    if (progress.passed < 0 || progress.passed >= route.count || progress.nearest < 0 ||
        progress.nearest >= route.count) {
        PyErr_SetString(PyExc_ValueError, "expected progress on the route");
        goto done;
    }
    advance_progress(&progress, &route, motion[0], motion[1]);
    if (PyErr_Occurred()) goto done;
    bool arrives = progress.has_arrived && fields[ARRIVED_TICK] == Py_None, moves = fabs(motion[2]) >= BLOCKED_SPEED;
    PyObject *values[PROGRESS_COUNT] = {
        PyLong_FromSsize_t(progress.passed),
        new_reference(arrives ? tick : fields[ARRIVED_TICK]),
        PyLong_FromSsize_t(progress.nearest),
        PyFloat_FromDouble(progress.off_route_m),
        PyBool_FromLong(progress.has_deviated),
        new_reference(moves ? tick : fields[MOVING_TICK]),
    };
    result = build_instance(&PROGRESS, &PROGRESS_FIELDS, values);
done:
    for (int i = 0; i < PROGRESS_COUNT; i++)
        if (fields[i]) Py_DecRef(fields[i]);
    close_route(&route);
    return result;
}

Functions scoring_criteria = {
    FUNCTION(scoring_criteria_advance_index),
    FUNCTION(scoring_criteria_update_progress),
    END_OF_FUNCTIONS,
};
