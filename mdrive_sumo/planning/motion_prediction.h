/* Predicted travel of road users for other C files: the twins of motion_prediction.py. */
#ifndef MDRIVE_MOTION_PREDICTION_H
#define MDRIVE_MOTION_PREDICTION_H

#include "path_overlap.h"

/* Rows of TIMES, and samples of a profile for each of them. */
enum { TIMES = 40, STRIDE = 2 };
static inline double get_time(Py_ssize_t row) { return (double)(row + 1) * 0.125 * STRIDE; }

/* parameters.MOTION */
typedef struct {
    double reliable_s, acceleration, top_speed, walking_top_speed, hesitation_braking, hesitation_s, reaction_s,
        yielding_braking, standing_speed, max_turn_rad;
} MotionParameters;
bool read_motion_parameters(MotionParameters *parameters);

static inline double clip(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

/* Distances at the time of a row [m]; those of predict_hesitation never decrease: `before` is that of the row before. */
static inline double predict_acceleration(const MotionParameters *parameters, double speed, double top_speed, Py_ssize_t row) {
    top_speed = speed > top_speed ? speed : top_speed;
    double t = get_time(row), ramp_s = (top_speed - speed) / parameters->acceleration, within = t < ramp_s ? t : ramp_s;
    return speed * within + parameters->acceleration * (within * within) / 2 + top_speed * (t - within);
}

static inline double predict_hesitation(const MotionParameters *parameters, double speed, Py_ssize_t row, double before) {
    double t = get_time(row), braking = parameters->hesitation_braking, hesitation_s = parameters->hesitation_s;
    double slow = t < hesitation_s ? t : hesitation_s;
    double lost = braking * (slow * slow) / 2 + braking * hesitation_s * (t - slow);
    double travelled = speed * t - lost;
    if (travelled < 0.0) travelled = 0.0;
    return travelled > before ? travelled : before;
}

static inline double predict_yielding(const MotionParameters *parameters, double speed, Py_ssize_t row) {
    double t = get_time(row), reaction_s = parameters->reaction_s, braking = parameters->yielding_braking;
    double until = t - reaction_s > 0.0 ? t - reaction_s : 0.0;
    if (!(until < speed / braking)) until = speed / braking;
    return speed * (t < reaction_s ? t : reaction_s) + speed * until - braking * (until * until) / 2;
}

/* Write the pose (x, y, yaw) after `travelled` [m] on an arc, a right angle at most; a heading that is no number is an
   error. */
bool place_on_arc(const double *pose, double travelled, double curvature, double max_turn_rad, double *placed);
/* Write the pose (x, y, yaw) at a station of the path. */
void place_on_path(const Path *path, double s, double *placed);
/* As ReferencePath.project. */
bool project_on_path(const Path *path, double x, double y, double near_s, double within_m, double *s);
/* The direction of the path at a station, as numpy.interp. */
double interpolate_yaw(const Path *path, double s);
/* As numpy.interp between values[0], values[step], ... at whole numbers; `count` values, at least one. */
double interpolate_cells(const double *values, Py_ssize_t step, Py_ssize_t count, double index);
#endif
