/* Moving scripted actors for other C files: see movers.py and path_tables.py. */
#ifndef MDRIVE_MOVERS_H
#define MDRIVE_MOVERS_H

#include "../core/compiled/values.h"

/* A row of type KNOT. */
typedef struct {
    double progress_key, length_key, progress, s, x, y, yaw;
} Knot;

/* A row of type MOVER. */
typedef struct {
    int64_t is_timed, is_pedestrian, avoids_collisions, stays_at_end;
    double half_length, half_width, accel, comfort_brake, max_brake, gap, look_margin, clearance, prediction_s;
    int64_t first, last;
    double begin, end, path_length, progress, speed, clock_rate, script_speed;
    int64_t is_braking, is_stopped, is_present, is_entering;
    double x, y, yaw, s, slope;
} Mover;

typedef struct {
    Array movers, knots;
    const Mover *mover;
    const Knot *knot;
    Py_ssize_t count; /* of movers */
} MoversOnPaths;
/* Each mover has two knots or more, which exist. */
bool open_movers_on_paths(PyObject *movers, PyObject *knots, MoversOnPaths *open);
void close_movers_on_paths(MoversOnPaths *open);

static const double TICK_S = 1.0 / 20;
static const double ROW_STRIDE = 1e6, LOG_TIME_TOLERANCE_S = 1e-6;

/* Of two numbers, as NumPy's minimum and maximum: NaN if one is. */
static inline double minimum(double a, double b) { return a < b || a != a ? a : b; }
static inline double maximum(double a, double b) { return a > b || a != a ? a : b; }
static inline double clip(double value, double low, double high) { return minimum(maximum(value, low), high); }

/* As kinematic_limits.compute_safe_speed. */
double compute_safe_speed(double room, double speed, double brake);
#endif
