/* Twins of plan_reader.py. */
#include "plan_reader.h"

#include <stdlib.h>

static Import CONTROL = {"mdrive_sumo.contract", "Control", 0};
FIELDS(CONTROL_FIELDS, "throttle", "brake", "steer");
FIELDS(OWN_FIELDS, "x", "y", "yaw", "speed", "acceleration", "yaw_rate");
FIELDS(PLAN_FIELDS, "points", "interval_s");

static const double TICK_S = 1.0 / 20, NEAR = 0.5;

bool read_own_motion(PyObject *object, OwnMotion *own) { return read_fields(object, &OWN_FIELDS, (double *)own); }

bool open_plan(PyObject *object, Plan *plan) {
    PyObject *points = get_field(object, &PLAN_FIELDS, 0), *interval = get_field(object, &PLAN_FIELDS, 1);
    bool is_open = points && interval && read_number(interval, &plan->interval_s) &&
                   open_doubles(points, 2, &plan->points); /* keeps a reference of its own */
    if (points) Py_DecRef(points);
    if (interval) Py_DecRef(interval);
    if (is_open && (plan->points.shape[0] < 1 || plan->points.shape[1] != 2)) {
        close_array(&plan->points);
        PyErr_SetString(PyExc_ValueError, "plan: expected one point or more, (N, 2)");
        return false;
    }
    return is_open;
}

static double round_to_step(double value, double low) {
    const double step = 1e-4, steps = 1e4;
    double most = value < 1.0 ? value : 1.0, bounded = most > low ? most : low;
    return round_even(bounded / step) / steps; /* the number nearest to the decimal fraction, as of round(..., 4) */
}

PyObject *build_control(double throttle, double brake, double steer) {
    double values[] = {round_to_step(throttle, 0.0), round_to_step(brake, 0.0), round_to_step(steer, -1.0)};
    return build_instance_of_numbers(&CONTROL, &CONTROL_FIELDS, values);
}

static PyObject *vehicle_control_plan_reader_round_control(PyObject *module, PyObject *const *arguments,
                                                           Py_ssize_t count) {
    double v[3];
    if (!expect_arguments("round_control", count, 3, 3) || !read_numbers(arguments, 3, v)) return NULL;
    return build_control(v[0], v[1], v[2]);
}

/* What is left of a plan: times and points in the ego frame; the car comes first. */
typedef struct {
    double *times;
    Point *points;
    Py_ssize_t count;
} Rest;

static void close_rest(Rest *rest) {
    free(rest->times);
    free(rest->points);
}

static bool find_remaining_points(const Plan *plan, const OwnMotion *own, Py_ssize_t age_ticks, Rest *rest) {
    Py_ssize_t points = plan->points.shape[0], first = 0;
    double age_s = age_ticks * TICK_S;
    while (first < points - 1 && plan->interval_s * (first + 1) - age_s <= 1e-9) first++;
    *rest = (Rest){malloc((points + 1) * sizeof *rest->times), malloc((points + 1) * sizeof *rest->points),
                   points - first + 1};
    CosSin ahead = cos_sin(own->yaw);
    if (rest->times && rest->points && isfinite(ahead.cos)) {
        rest->times[0] = 0.0, rest->points[0] = (Point){0.0, 0.0};
        for (Py_ssize_t i = first; i < points; i++) {
            Point at = ((const Point *)plan->points.data)[i];
            rest->times[i - first + 1] = greatest(plan->interval_s * (i + 1) - age_s, 0.0);
            rest->points[i - first + 1] = point_to_ego_frame(at.x, at.y, ahead, own);
        }
        return true;
    }
    if (rest->times && rest->points) refuse_numbers("find_remaining_points");
    else PyErr_NoMemory();
    close_rest(rest);
    return false;
}

static bool open_rest(PyObject *const *arguments, Rest *rest) {
    Plan plan;
    OwnMotion own;
    Py_ssize_t age_ticks;
    if (!read_own_motion(arguments[1], &own) || !read_integer(arguments[2], &age_ticks) ||
        !open_plan(arguments[0], &plan))
        return false;
    bool is_open = find_remaining_points(&plan, &own, age_ticks, rest);
    close_array(&plan.points);
    return is_open;
}

/* As numpy.interp, of both coordinates: stations increase. */
static Point interpolate(double at, const double *stations, const Point *points, Py_ssize_t count) {
    Py_ssize_t i = 0;
    if (at < stations[0]) return points[0];
    while (i < count - 1 && stations[i + 1] <= at) i++;
    if (i == count - 1 || stations[i] == at) return points[i];
    double rest = at - stations[i], step = stations[i + 1] - stations[i];
    return (Point){(points[i + 1].x - points[i].x) / step * rest + points[i].x,
                   (points[i + 1].y - points[i].y) / step * rest + points[i].y};
}

/* As `interpolate`, and beyond the last station straight on. */
static Point extrapolate(double at, const double *stations, const Point *points, Py_ssize_t count) {
    Point last = points[count - 1], before = points[count - 2], inner = interpolate(at, stations, points, count);
    double step = stations[count - 1] - stations[count - 2], over = greatest(at - stations[count - 1], 0.0);
    return (Point){inner.x + over * ((last.x - before.x) / step), inner.y + over * ((last.y - before.y) / step)};
}

static PyObject *vehicle_control_plan_reader_sample_waypoints(PyObject *module, PyObject *const *arguments,
                                                              Py_ssize_t count) {
    double spacing_s, *data;
    Py_ssize_t wanted;
    Rest rest;
    if (!expect_arguments("sample_waypoints", count, 5, 5) || !read_number(arguments[3], &spacing_s) ||
        !read_integer(arguments[4], &wanted) || !open_rest(arguments, &rest))
        return NULL;
    PyObject *result = new_doubles(2, (Py_ssize_t[]){wanted, 2}, &data);
    bool is_overdue = rest.times[rest.count - 1] <= 0.0;
    for (Py_ssize_t i = 0; result && i < wanted; i++)
        ((Point *)data)[i] = is_overdue ? rest.points[rest.count - 1]
                                        : extrapolate(spacing_s * (i + 1), rest.times, rest.points, rest.count);
    close_rest(&rest);
    return result;
}

static PyObject *vehicle_control_plan_reader_find_aim_point(PyObject *module, PyObject *const *arguments,
                                                            Py_ssize_t count) {
    double distance;
    Rest rest;
    if (!expect_arguments("find_aim_point", count, 4, 4) || !read_number(arguments[3], &distance) ||
        !open_rest(arguments, &rest))
        return NULL;
    double *along = rest.times; /* is not needed here */
    Py_ssize_t kept = 1;
    Point before = rest.points[0];
    along[0] = 0.0;
    for (Py_ssize_t i = 1; i < rest.count; i++) {
        Point here = rest.points[i];
        double hop = portable_hypot(here.x - before.x, here.y - before.y);
        before = here;
        if (hop > 1e-6) along[kept] = along[kept - 1] + hop, rest.points[kept++] = here;
    }
    Point aim = along[kept - 1] < NEAR ? (Point){distance, 0.0} : extrapolate(distance, along, rest.points, kept);
    close_rest(&rest);
    return build_tuple(2, (double[]){aim.x, aim.y});
}

Functions vehicle_control_plan_reader = {
    FUNCTION(vehicle_control_plan_reader_round_control),
    FUNCTION(vehicle_control_plan_reader_sample_waypoints),
    FUNCTION(vehicle_control_plan_reader_find_aim_point),
    END_OF_FUNCTIONS,
};
