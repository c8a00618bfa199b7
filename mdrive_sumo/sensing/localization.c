/* Twins of localization.py. */
#include "../core/compiled/values.h"
#include "../core/portable.h"
#include "../core/seeding.h"

static Import EGO_STATE = {"mdrive_sumo.core.state", "EgoState", 0};
static Import OWN_STATE = {"mdrive_sumo.contract.exchange", "OwnState", 0};
FIELDS(EGO_FIELDS, "x", "y", "yaw", "speed", "acceleration", "yaw_rate", "steer_angle");
FIELDS(OWN_FIELDS, "x", "y", "yaw", "speed", "acceleration", "yaw_rate", "steer_angle", "position_sigma", "yaw_sigma",
       "speed_sigma");
FIELDS(PARAMETER_FIELDS, "position_sigma", "yaw_sigma", "speed_share", "yaw_rate_sigma");
enum { X, Y, YAW, SPEED, ACCELERATION, YAW_RATE, STEER_ANGLE, EGO_COUNT, OWN_COUNT = EGO_COUNT + 3 };
enum { POSITION_SIGMA, YAW_SIGMA, SPEED_SHARE, YAW_RATE_SIGMA, PARAMETER_COUNT };
enum { ERROR_COUNT = 5, DRIFTING = 3 };

static bool read_errors(PyObject *all, Py_ssize_t tick, double errors[ERROR_COUNT]) {
    PyObject *row = PyList_GetItem(all, tick);
    if (!row) return false;
    for (int i = 0; i < ERROR_COUNT; i++) {
        PyObject *value = PyTuple_GetItem(row, i);
        if (!value || !read_number(value, errors + i)) return false;
    }
    return true;
}

static bool append_errors(PyObject *all, int64_t seed, double kept) {
    Py_ssize_t tick = PyList_Size(all);
    Purpose purpose = start_purpose(seed);
    add_text(&purpose, "own-state", 9);
    add_number(&purpose, tick);
    double drawn[UNIFORMS], last[ERROR_COUNT], fresh = sqrt(1 - kept * kept);
    draw_normals(&purpose, drawn);
    if (tick > 0) {
        if (!read_errors(all, tick - 1, last)) return false;
        for (int i = 0; i < DRIFTING; i++) drawn[i] = kept * last[i] + fresh * drawn[i];
    }
    PyObject *row = build_tuple(ERROR_COUNT, drawn);
    bool is_added = row && PyList_Append(all, row) == 0;
    if (row) Py_DecRef(row);
    return is_added;
}

static PyObject *sensing_localization_estimate_state(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("estimate_state", count, 6, 6)) return NULL;
    PyObject *parameters = arguments[0], *errors = arguments[3];
    Py_ssize_t seed, tick;
    double kept, sigma[PARAMETER_COUNT], state[EGO_COUNT], error[ERROR_COUNT];
    if (!read_integer(arguments[1], &seed) || !read_number(arguments[2], &kept) || !read_integer(arguments[4], &tick) ||
        !read_fields(parameters, &PARAMETER_FIELDS, sigma) || !read_fields(arguments[5], &EGO_FIELDS, state))
        return NULL;
    for (Py_ssize_t known = PyList_Size(errors); known <= tick; known++)
        if (known < 0 || !append_errors(errors, seed, kept)) return NULL;
    if (!read_errors(errors, tick, error)) return NULL;
    state[X] += sigma[POSITION_SIGMA] * error[0];
    state[Y] += sigma[POSITION_SIGMA] * error[1];
    state[YAW] += sigma[YAW_SIGMA] * error[2];
    state[SPEED] *= 1 + sigma[SPEED_SHARE] * error[3];
    state[YAW_RATE] += sigma[YAW_RATE_SIGMA] * error[4];
    return build_instance_of_numbers(&EGO_STATE, &EGO_FIELDS, state);
}

static PyObject *sensing_localization_describe_estimate(PyObject *module, PyObject *const *arguments,
                                                        Py_ssize_t count) {
    if (!expect_arguments("describe_estimate", count, 2, 2)) return NULL;
    double sigma[PARAMETER_COUNT], state[OWN_COUNT];
    if (!read_fields(arguments[0], &PARAMETER_FIELDS, sigma) || !read_fields(arguments[1], &EGO_FIELDS, state))
        return NULL;
    state[EGO_COUNT] = sigma[POSITION_SIGMA];
    state[EGO_COUNT + 1] = sigma[YAW_SIGMA];
    state[EGO_COUNT + 2] = sigma[SPEED_SHARE] * fabs(state[SPEED]);
    return build_instance_of_numbers(&OWN_STATE, &OWN_FIELDS, state);
}

static PyObject *sensing_localization_to_own_state(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("to_own_state", count, 1, 1)) return NULL;
    double state[OWN_COUNT] = {0};
    if (!read_fields(arguments[0], &EGO_FIELDS, state)) return NULL;
    return build_instance_of_numbers(&OWN_STATE, &OWN_FIELDS, state);
}

Functions sensing_localization = {
    FUNCTION(sensing_localization_estimate_state),
    FUNCTION(sensing_localization_describe_estimate),
    FUNCTION(sensing_localization_to_own_state),
    END_OF_FUNCTIONS,
};
