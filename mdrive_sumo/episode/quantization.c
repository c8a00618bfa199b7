/* Twins of quantization.py. */
#include "../core/compiled/values.h"
#include "../core/portable.h"

static Import FRAME = {"mdrive_sumo.core.state", "Frame", 0}, ACTORS = {"mdrive_sumo.core.state", "Actors", 0},
              EGO_STATE = {"mdrive_sumo.core.state", "EgoState", 0};
FIELDS(FRAME_FIELDS, "tick", "egos", "actors", "signals", "contacts");
FIELDS(ACTOR_FIELDS, "ids", "kind", "x", "y", "yaw", "speed", "length", "width");
FIELDS(EGO_FIELDS, "x", "y", "yaw", "speed", "acceleration", "yaw_rate", "steer_angle");
FIELDS(MOTION_FIELDS, "x", "y", "yaw", "speed");
FIELDS(CONTROL_FIELDS, "throttle", "brake", "steer");
enum { TICK, EGOS, ACTORS_OF, SIGNALS, CONTACTS };
enum { FIRST_MOTION = 2, MOTION_COUNT = 4, EGO_COUNT = 7, CONTROL_COUNT = 3 };

static const double RESOLUTION[MOTION_COUNT] = {1e-3, 1e-3, 1e-4, 1e-3}, CONTROL_STEP = 1e-4;

/* As numpy.rint, and fast in a loop: adding 2^52 with the sign of x leaves no place for a fraction. */
static inline double round_to_whole(double x) {
    double shift = copysign(4503599627370496.0, x);
    return fabs(x) < 4503599627370496.0 ? copysign((x + shift) - shift, x) : x;
}

static PyObject *quantize_ego(PyObject *ego) {
    double state[EGO_COUNT];
    if (!read_fields(ego, &EGO_FIELDS, state)) return NULL;
    for (int i = 0; i < MOTION_COUNT; i++) {
        double whole = round_even(state[i] / RESOLUTION[i]);
        if (!isfinite(whole)) {
            PyErr_SetString(PyExc_ValueError, "expected a finite state of a CAV");
            return NULL;
        }
        state[i] = (whole + 0.0) * RESOLUTION[i]; /* -0.0 becomes 0.0: an integer has no negative zero */
    }
    return build_instance_of_numbers(&EGO_STATE, &EGO_FIELDS, state);
}

static PyObject *quantize_egos(PyObject *egos) {
    if (!is_dict(egos)) return NULL;
    PyObject *rounded = PyDict_New(), *name, *ego;
    for (Py_ssize_t at = 0; rounded && PyDict_Next(egos, &at, &name, &ego);) {
        PyObject *one = quantize_ego(ego);
        if (!one || PyDict_SetItem(rounded, name, one)) {
            Py_DecRef(rounded);
            rounded = NULL;
        }
        if (one) Py_DecRef(one);
    }
    return rounded;
}

static PyObject *quantize_column(PyObject *column, double step) {
    Array from;
    if (!open_array(column, 'd', &from)) return NULL;
    double *to;
    PyObject *rounded = new_doubles(from.dimensions, from.shape, &to);
    for (Py_ssize_t i = 0; rounded && i < from.count; i++) to[i] = round_to_whole(doubles(&from)[i] / step) * step;
    close_array(&from);
    return rounded;
}

static PyObject *quantize_actors(PyObject *actors) {
    if (PyObject_Size(actors) == 0) return new_reference(actors);
    PyObject *fields[8] = {0};
    for (int i = 0; i < ACTOR_FIELDS.count; i++) {
        if (!(fields[i] = get_field(actors, &ACTOR_FIELDS, i))) break;
        if (i < FIRST_MOTION || i >= FIRST_MOTION + MOTION_COUNT) continue;
        PyObject *rounded = quantize_column(fields[i], RESOLUTION[i - FIRST_MOTION]);
        Py_DecRef(fields[i]);
        if (!(fields[i] = rounded)) break;
    }
    return build_instance(&ACTORS, &ACTOR_FIELDS, fields);
}

static PyObject *episode_quantization_quantize_frame(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("quantize_frame", count, 1, 1)) return NULL;
    PyObject *fields[5] = {0};
    for (int i = 0; i < FRAME_FIELDS.count; i++) {
        PyObject *field = get_field(arguments[0], &FRAME_FIELDS, i);
        if (!field) break;
        fields[i] = i == EGOS ? quantize_egos(field) : i == ACTORS_OF ? quantize_actors(field) : new_reference(field);
        Py_DecRef(field);
        if (!fields[i]) break;
    }
    return build_instance(&FRAME, &FRAME_FIELDS, fields);
}

static bool write_whole(double value, double step, int32_t *whole) {
    double rounded = round_even(value / step);
    if (rounded >= INT32_MIN && rounded <= INT32_MAX) {
        *whole = (int32_t)rounded;
        return true;
    }
    PyErr_SetString(PyExc_ValueError, "expected a state that a recording can hold");
    return false;
}

static bool pack_egos(PyObject *egos, int32_t *states) {
    PyObject *name, *ego;
    for (Py_ssize_t at = 0; PyDict_Next(egos, &at, &name, &ego); states += MOTION_COUNT) {
        double motion[MOTION_COUNT];
        if (!read_fields(ego, &MOTION_FIELDS, motion)) return false;
        for (int i = 0; i < MOTION_COUNT; i++)
            if (!write_whole(motion[i], RESOLUTION[i], states + i)) return false;
    }
    return true;
}

static bool pack_column(PyObject *actors, Py_ssize_t rows, int column, int32_t *states) {
    PyObject *values = get_field(actors, &MOTION_FIELDS, column);
    Array from;
    bool is_packed = values && open_doubles(values, 1, &from);
    if (values) Py_DecRef(values);
    if (!is_packed) return false;
    if (from.count != rows) {
        PyErr_SetString(PyExc_ValueError, "expected a number for every actor");
        is_packed = false;
    }
    for (Py_ssize_t row = 0; is_packed && row < rows; row++)
        is_packed = write_whole(doubles(&from)[row], RESOLUTION[column], states + row * MOTION_COUNT + column);
    close_array(&from);
    return is_packed;
}

static PyObject *episode_quantization_pack_states(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("pack_states", count, 1, 1)) return NULL;
    PyObject *egos = get_field(arguments[0], &FRAME_FIELDS, EGOS);
    PyObject *actors = egos ? get_field(arguments[0], &FRAME_FIELDS, ACTORS_OF) : NULL, *packed = NULL;
    Py_ssize_t cavs = egos && is_dict(egos) ? PyObject_Size(egos) : -1, others = -1;
    if (cavs >= 0 && actors) others = PyObject_Size(actors);
    if (cavs >= 0 && others >= 0)
        packed = PyBytes_FromStringAndSize(NULL, (cavs + others) * MOTION_COUNT * (Py_ssize_t)sizeof(int32_t));
    int32_t *states = packed ? (int32_t *)PyBytes_AsString(packed) : NULL;
    bool is_packed = packed && pack_egos(egos, states);
    for (int i = 0; is_packed && others && i < MOTION_COUNT; i++)
        is_packed = pack_column(actors, others, i, states + cavs * MOTION_COUNT);
    if (packed && !is_packed) {
        Py_DecRef(packed);
        packed = NULL;
    }
    if (egos) Py_DecRef(egos);
    if (actors) Py_DecRef(actors);
    return packed;
}

static PyObject *episode_quantization_pack_controls(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("pack_controls", count, 2, 2)) return NULL;
    PyObject *egos = arguments[0], *controls = arguments[1];
    Py_ssize_t cavs = PyTuple_Size(egos);
    if (cavs < 0 || !is_dict(controls)) return NULL;
    PyObject *packed = PyBytes_FromStringAndSize(NULL, cavs * CONTROL_COUNT * (Py_ssize_t)sizeof(int16_t));
    int16_t *next = packed ? (int16_t *)PyBytes_AsString(packed) : NULL;
    for (Py_ssize_t i = 0; packed && i < cavs; i++) {
        PyObject *control = PyDict_GetItemWithError(controls, PyTuple_GetItem(egos, i));
        double values[CONTROL_COUNT] = {0};
        bool is_packed = control ? read_fields(control, &CONTROL_FIELDS, values) : !PyErr_Occurred();
        for (int j = 0; is_packed && j < CONTROL_COUNT; j++) {
            int32_t whole;
            is_packed = write_whole(values[j], CONTROL_STEP, &whole);
            if (is_packed && whole != (int16_t)whole) {
                PyErr_SetString(PyExc_OverflowError, "expected a control in [-1, 1]");
                is_packed = false;
            }
            if (is_packed) *next++ = (int16_t)whole;
        }
        if (!is_packed) {
            Py_DecRef(packed);
            packed = NULL;
        }
    }
    return packed;
}

static PyObject *episode_quantization_round_points(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Array from;
    if (!expect_arguments("round_points", count, 1, 1) || !open_array(arguments[0], 'd', &from)) return NULL;
    double *to;
    PyObject *rounded = new_doubles(from.dimensions, from.shape, &to);
    for (Py_ssize_t i = 0; rounded && i < from.count; i++) to[i] = round_to_whole(doubles(&from)[i] * 100.0) / 100.0;
    close_array(&from);
    return rounded;
}

Functions episode_quantization = {
    FUNCTION(episode_quantization_quantize_frame),
    FUNCTION(episode_quantization_pack_states),
    FUNCTION(episode_quantization_pack_controls),
    FUNCTION(episode_quantization_round_points),
    END_OF_FUNCTIONS,
};
