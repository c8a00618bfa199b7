/* Twins of interaction_prediction.py: the motion of one road user in one call. */
#include <string.h>

#include "../core/state.h"
#include "motion_prediction.h"

FIELDS(MOTION, "poses", "length", "width", "reason", "stands_at_end", "min_gap_m");
FIELDS(REASON, "cause", "others", "position", "distance_m", "seconds", "speed");
FIELDS(CAUSES, "FOLLOW", "BLOCKED", "AVOID", "YIELD");
enum { FOLLOW, BLOCKED, AVOID, YIELD };
FIELDS(QUEUE, "exact_m", "sigmas", "most_m");
FIELDS(INTERACTION, "same_direction_rad");
static Import PREDICTED_MOTION = {"mdrive_sumo.planning.motion_prediction", "PredictedMotion", 0};
static Import REASON_CLASS = {"mdrive_sumo.contract.reason", "Reason", 0};
static Import CAUSE = {"mdrive_sumo.contract.reason", "Cause", 0};
static Import QUEUE_GAP = {"mdrive_sumo.planning.interaction_prediction", "QUEUE_GAP", 0};

/* One row of the road users. */
typedef struct {
    double pose[3], speed, length, width;
    int kind;
    PyObject *id; /* a reference of its own */
} Other;

static bool read_other(PyObject *objects, PyObject *row, Other *other) {
    Py_ssize_t i;
    RoadUsers users;
    if (!read_integer(row, &i) || !open_road_users(objects, &users)) return false;
    bool exists = i >= 0 && i < users.count;
    if (exists) {
        *other = (Other){{x_of(&users)[i], y_of(&users)[i], yaws_of(&users)[i]}, speeds_of(&users)[i],
                         lengths_of(&users)[i], widths_of(&users)[i], kinds_of(&users)[i],
                         new_reference(PyTuple_GetItem(users.ids, i))};
    } else {
        PyErr_Format(PyExc_ValueError, "expected a row below %zd, found %zd", users.count, i);
    }
    close_road_users(&users);
    return exists;
}

/* distance_m is taken. */
static PyObject *build_reason(const Other *other, int cause, PyObject *distance_m) {
    PyObject *causes = find_import(&CAUSE);
    PyObject *values[] = {causes ? get_field(causes, &CAUSES, cause) : NULL,
                          pack(1, new_reference(other->id)),
                          build_tuple(2, other->pose),
                          distance_m,
                          new_reference(Py_None),
                          new_reference(Py_None)};
    return build_instance(&REASON_CLASS, &REASON, values);
}

/* Poses, length and reason are taken. */
static PyObject *build_motion(const Other *other, PyObject *poses, PyObject *length, PyObject *reason, bool stands_at_end,
                              double min_gap_m) {
    PyObject *values[] = {poses,  length, PyFloat_FromDouble(other->width), reason, PyBool_FromLong(stands_at_end),
                          PyFloat_FromDouble(min_gap_m)};
    return build_instance(&PREDICTED_MOTION, &MOTION, values);
}

/* An object at TIMES with a travel for each row, that stands at the end; the reason is taken. */
static PyObject *move_on_arc(const Other *other, const MotionParameters *parameters, bool is_static, double curvature,
                             PyObject *reason) {
    double *poses;
    PyObject *array = new_doubles(2, (Py_ssize_t[]){TIMES, 3}, &poses);
    for (Py_ssize_t row = 0; array && row < TIMES; row++) {
        double travelled = is_static ? 0.0 * get_time(row) : predict_yielding(parameters, other->speed, row);
        if (!place_on_arc(other->pose, travelled, curvature, parameters->max_turn_rad, poses + 3 * row))
            Py_DecRef(array), array = NULL;
    }
    return build_motion(other, array, PyFloat_FromDouble(other->length), reason, true, 0.0);
}

/* An object that travels between hesitation and `most`, of which a top speed below 0 means constant speed: its box
   covers both, as far as it is reliable. The reason is taken. */
static PyObject *move_between(const Other *other, const MotionParameters *parameters, double curvature, double top_speed,
                              PyObject *reason) {
    Py_ssize_t rows = 0;
    while (rows < TIMES && get_time(rows) <= parameters->reliable_s) rows++;
    double *poses, *lengths, least_m = 0.0;
    PyObject *array = new_doubles(2, (Py_ssize_t[]){rows, 3}, &poses);
    PyObject *length = array ? new_doubles(1, &rows, &lengths) : NULL;
    bool is_placed = length != NULL;
    for (Py_ssize_t row = 0; is_placed && row < rows; row++) {
        least_m = predict_hesitation(parameters, other->speed, row, least_m);
        double most_m = top_speed < 0.0 ? other->speed * get_time(row)
                                        : predict_acceleration(parameters, other->speed, top_speed, row);
        lengths[row] = other->length + (most_m - least_m);
        is_placed = place_on_arc(other->pose, (most_m + least_m) / 2, curvature, parameters->max_turn_rad, poses + 3 * row);
    }
    if (!is_placed && array) Py_DecRef(array), array = NULL;
    return build_motion(other, array, length, reason, false, 0.0);
}

static PyObject *planning_interaction_prediction_predict_merging(PyObject *module, PyObject *const *arguments,
                                                                 Py_ssize_t count) {
    MotionParameters parameters;
    double curvature;
    Other other;
    if (!expect_arguments("predict_merging", count, 3, 3) || !read_motion_parameters(&parameters) ||
        !read_number(arguments[2], &curvature) || !read_other(arguments[0], arguments[1], &other))
        return NULL;
    PyObject *reason = build_reason(&other, AVOID, new_reference(Py_None));
    PyObject *result = move_between(&other, &parameters, curvature, -1.0, reason);
    Py_DecRef(other.id);
    return result;
}

static PyObject *planning_interaction_prediction_predict_crossing(PyObject *module, PyObject *const *arguments,
                                                                  Py_ssize_t count) {
    MotionParameters parameters;
    double curvature, top_speed;
    Other other;
    if (!expect_arguments("predict_crossing", count, 5, 5) || !read_motion_parameters(&parameters) ||
        !read_number(arguments[2], &curvature) || !read_number(arguments[4], &top_speed))
        return NULL;
    int goes_first = PyObject_IsTrue(arguments[3]);
    if (goes_first < 0 || !read_other(arguments[0], arguments[1], &other)) return NULL;
    PyObject *reason = build_reason(&other, goes_first ? YIELD : AVOID, new_reference(Py_None)), *result;
    if (goes_first && other.kind != STATIC)
        result = move_between(&other, &parameters, curvature, top_speed, reason);
    else
        result = move_on_arc(&other, &parameters, goes_first, goes_first ? 0.0 : curvature, reason);
    Py_DecRef(other.id);
    return result;
}

/* Where on the own path an object is, and how it is related to it. */
typedef struct {
    double station, sigma;
    bool is_aligned, moves;
} OnPath;

static bool find_on_path(const Other *other, const Path *path, const double *numbers, double same_direction_rad,
                         double standing_speed, OnPath *on_path) {
    double look_m = numbers[1];
    if (!project_on_path(path, other->pose[0], other->pose[1], numbers[0] + look_m / 2, look_m, &on_path->station))
        return false;
    double turned = other->pose[2] - interpolate_yaw(path, on_path->station);
    if (isinf(turned)) {
        PyErr_SetString(PyExc_ValueError, "expected finite headings, found infinity");
        return false;
    }
    on_path->is_aligned = fabs(wrap_angle(turned)) < same_direction_rad;
    on_path->moves = on_path->is_aligned && fabs(other->speed) > standing_speed;
    on_path->sigma = numbers[3];
    return true;
}

static PyObject *place_lead_object(const Other *other, const Path *path, const MotionParameters *parameters,
                                   const OnPath *on_path) {
    double *poses;
    PyObject *array = new_doubles(2, (Py_ssize_t[]){TIMES, 3}, &poses);
    for (Py_ssize_t row = 0; array && row < TIMES; row++) {
        double travelled = predict_yielding(parameters, other->speed, row);
        if (on_path->moves) place_on_path(path, on_path->station + travelled, poses + 3 * row);
        else if (!place_on_arc(other->pose, travelled, 0.0, parameters->max_turn_rad, poses + 3 * row))
            Py_DecRef(array), array = NULL;
    }
    return array;
}

/* As compute_queue_gap, 0 for an object that does not lead. */
static bool find_min_gap(const Other *other, const OnPath *on_path, double *gap_m) {
    double numbers[3];
    PyObject *parameters = find_import(&QUEUE_GAP);
    *gap_m = 0.0;
    if (!on_path->is_aligned || other->kind == STATIC) return true;
    if (!parameters || !read_fields(parameters, &QUEUE, numbers)) return false;
    *gap_m = numbers[0] + numbers[1] * on_path->sigma;
    if (numbers[2] < *gap_m) *gap_m = numbers[2];
    return true;
}

static PyObject *predict_lead(const Other *other, const Path *path, const MotionParameters *parameters,
                              const double *numbers, double same_direction_rad) {
    OnPath on_path;
    double min_gap_m;
    if (!find_on_path(other, path, numbers, same_direction_rad, parameters->standing_speed, &on_path) ||
        !find_min_gap(other, &on_path, &min_gap_m))
        return NULL;
    double gap_m = on_path.station - numbers[0] - (numbers[2] + other->length) / 2;
    PyObject *distance_m = PyFloat_FromDouble(0.0 > gap_m ? 0.0 : gap_m);
    PyObject *reason = build_reason(other, on_path.moves ? FOLLOW : BLOCKED, distance_m);
    PyObject *poses = place_lead_object(other, path, parameters, &on_path);
    return build_motion(other, poses, PyFloat_FromDouble(other->length), reason, true, min_gap_m);
}

static PyObject *planning_interaction_prediction_predict_lead_object(PyObject *module, PyObject *const *arguments,
                                                                     Py_ssize_t count) {
    MotionParameters parameters;
    double numbers[4], same_direction_rad; /* own station, how far to look, own length, standard deviation */
    Other other;
    Path path;
    if (!expect_arguments("predict_lead_object", count, 8, 8) || !read_motion_parameters(&parameters) ||
        !read_numbers(arguments + 3, 4, numbers) ||
        !read_number_field(arguments[7], &INTERACTION, 0, &same_direction_rad) ||
        !read_other(arguments[0], arguments[1], &other))
        return NULL;
    PyObject *result = NULL;
    if (open_path(arguments[2], &path)) {
        result = predict_lead(&other, &path, &parameters, numbers, same_direction_rad);
        close_path(&path);
    }
    Py_DecRef(other.id);
    return result;
}

Functions planning_interaction_prediction = {
    FUNCTION(planning_interaction_prediction_predict_lead_object),
    FUNCTION(planning_interaction_prediction_predict_merging),
    FUNCTION(planning_interaction_prediction_predict_crossing),
    END_OF_FUNCTIONS,
};
