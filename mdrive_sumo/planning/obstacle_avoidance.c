/* Twin of obstacle_avoidance.py. */
#include "../core/state.h"
#include "../core/geometry.h"

FIELDS(PARAMETERS, "suspected_s", "moving_speed", "queue_radius_m");

static bool is_near_moving(const RoadUsers *users, const double *standstill_s, const double *parameters, Py_ssize_t row) {
    for (Py_ssize_t other = 0; other < users->count; other++) {
        if (!(standstill_s[other] < parameters[0] && fabs(speeds_of(users)[other]) > parameters[1])) continue;
        double gap_m = portable_hypot(x_of(users)[row] - x_of(users)[other], y_of(users)[row] - y_of(users)[other]);
        if (gap_m < parameters[2]) return true;
    }
    return false;
}

static PyObject *planning_obstacle_avoidance_find_queued(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double parameters[3];
    RoadUsers users;
    Array standstill_s;
    if (!expect_arguments("find_queued", count, 3, 3) || !read_fields(arguments[2], &PARAMETERS, parameters) ||
        !open_doubles(arguments[1], 1, &standstill_s))
        return NULL;
    if (!open_road_users(arguments[0], &users)) {
        close_array(&standstill_s);
        return NULL;
    }
    void *mask = NULL;
    PyObject *result = NULL;
    if (standstill_s.count == users.count) result = new_array('?', 1, &users.count, &mask);
    else PyErr_SetString(PyExc_ValueError, "expected a duration for each object");
    for (Py_ssize_t row = 0; result && row < users.count; row++)
        ((bool *)mask)[row] = is_near_moving(&users, doubles(&standstill_s), parameters, row);
    close_array(&standstill_s);
    close_road_users(&users);
    return result;
}

Functions planning_obstacle_avoidance = {
    FUNCTION(planning_obstacle_avoidance_find_queued),
    END_OF_FUNCTIONS,
};
