/* Twin of pedestrian_caution.py. */
#include "../core/geometry.h"
#include "../core/state.h"

FIELDS(PARAMETERS, "standing_speed", "started_m", "walking_speed");
enum { STANDING_SPEED, STARTED_M, WALKING_SPEED, NUMBERS };

static bool has_started(const RoadUsers *users, Py_ssize_t row, PyObject *first_positions, const double *parameters,
                        bool *has) {
    double x = x_of(users)[row], y = y_of(users)[row], first[2] = {x, y};
    PyObject *known = PyDict_GetItemWithError(first_positions, PyTuple_GetItem(users->ids, row));
    PyObject *first_x = known ? PySequence_GetItem(known, 0) : NULL, *first_y = first_x ? PySequence_GetItem(known, 1) : NULL;
    bool is_read = known ? first_y && read_number(first_x, first) && read_number(first_y, first + 1) : !PyErr_Occurred();
    if (first_x) Py_DecRef(first_x);
    if (first_y) Py_DecRef(first_y);
    *has = portable_hypot(x - first[0], y - first[1]) > parameters[STARTED_M];
    return is_read;
}

static PyObject *planning_pedestrian_caution_predict_walking_speeds(PyObject *module, PyObject *const *arguments,
                                                                    Py_ssize_t count) {
    double parameters[NUMBERS], *speed;
    RoadUsers users;
    if (!expect_arguments("predict_walking_speeds", count, 3, 3) || !read_fields(arguments[2], &PARAMETERS, parameters) ||
        !open_road_users(arguments[0], &users))
        return NULL;
    PyObject *result = new_doubles(1, &users.count, &speed);
    for (Py_ssize_t row = 0; result && row < users.count; row++) {
        speed[row] = speeds_of(&users)[row];
        if (kinds_of(&users)[row] != PEDESTRIAN || !(fabs(speed[row]) < parameters[STANDING_SPEED])) continue;
        bool has;
        if (!has_started(&users, row, arguments[1], parameters, &has)) Py_DecRef(result), result = NULL;
        else if (has) speed[row] = parameters[WALKING_SPEED];
    }
    close_road_users(&users);
    return result;
}

Functions planning_pedestrian_caution = {
    FUNCTION(planning_pedestrian_caution_predict_walking_speeds),
    END_OF_FUNCTIONS,
};
