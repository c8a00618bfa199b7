/* Twins of announcement.py: what an announced trajectory means some time later. */
#include <string.h>

#include "../planning/motion_prediction.h"
#include "intention.h"

FIELDS(TRAJECTORY, "line", "times", "last_speed");
FIELDS(ANNOUNCED, "mcm", "planned", "desired");
FIELDS(MCM, "pose", "speed", "intention", "direction");
FIELDS(POSE, "yaw");
FIELDS(MEMBER, "id", "x", "y", "yaw", "speed", "intention", "direction", "interval_s", "desired", "planned",
       "position_sigma", "yaw_sigma");
static Import ANNOUNCED_TRAJECTORY = {"mdrive_sumo.negotiation.announcement", "AnnouncedTrajectory", 0};
static Import NEGOTIATION_MEMBER = {"mdrive_sumo.negotiation.negotiator", "NegotiationMember", 0};

typedef struct {
    Line line;
    Array times;
    double last_speed;
} Trajectory;

static bool open_trajectory(PyObject *trajectory, Trajectory *opened) {
    if (!read_number_field(trajectory, &TRAJECTORY, 2, &opened->last_speed) ||
        !open_field(trajectory, &TRAJECTORY, 1, 'd', 1, &opened->times))
        return false;
    PyObject *line = get_field(trajectory, &TRAJECTORY, 0);
    bool is_open = line && open_line(line, &opened->line);
    if (line) Py_DecRef(line);
    if (!is_open) {
        close_array(&opened->times);
        return false;
    }
    if (opened->times.count == opened->line.count) return true;
    PyErr_SetString(PyExc_ValueError, "expected a time for each point of a trajectory");
    close_array(&opened->times);
    close_line(&opened->line);
    return false;
}

static void close_trajectory(Trajectory *trajectory) {
    close_array(&trajectory->times);
    close_line(&trajectory->line);
}

static double compute_travelled(const Trajectory *trajectory, double t) {
    Py_ssize_t count = trajectory->times.count;
    const double *times = doubles(&trajectory->times);
    double beyond = t - times[count - 1];
    if (beyond < 0.0) beyond = 0.0;
    return interpolate(t, times, doubles(&trajectory->line.s), 1, count) + trajectory->last_speed * beyond;
}

static Point find_point(const Trajectory *trajectory, double t) {
    if (trajectory->line.count > 1) return sample_point(&trajectory->line, compute_travelled(trajectory, t));
    const double *start = doubles(&trajectory->line.points);
    return (Point){start[0], start[1]};
}

static double find_time(const Trajectory *trajectory, double s, double latest) {
    const double *stations = doubles(&trajectory->line.s), *times = doubles(&trajectory->times);
    Py_ssize_t reached = 0, count = trajectory->times.count;
    while (reached < count && stations[reached] < s - 1e-9) reached++;
    if (!reached) return 0.0;
    double time = times[count - 1];
    if (reached < count) {
        double before = stations[reached - 1], share = (s - before) / (stations[reached] - before);
        time = times[reached - 1] + share * (times[1] - times[0]);
    }
    return reached < count ? (latest < time ? latest : time) : (time < latest ? time : latest);
}

static PyObject *join_points(PyObject *here, const Array *points) {
    double *line, start[2];
    PyObject *x = PySequence_GetItem(here, 0), *y = x ? PySequence_GetItem(here, 1) : NULL;
    bool is_read = y && read_number(x, start) && read_number(y, start + 1);
    if (x) Py_DecRef(x);
    if (y) Py_DecRef(y);
    PyObject *array = is_read ? new_doubles(2, (Py_ssize_t[]){points->shape[0] + 1, 2}, &line) : NULL;
    if (!array) return NULL;
    memcpy(line, start, sizeof start);
    if (points->count) memcpy(line + 2, doubles(points), (size_t)points->count * sizeof(double));
    return array;
}

static PyObject *negotiation_announcement_measure_trajectory(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double interval_s, *times;
    Array points, s;
    if (!expect_arguments("measure_trajectory", count, 3, 3) || !read_number(arguments[2], &interval_s) ||
        !open_doubles(arguments[1], 2, &points))
        return NULL;
    Py_ssize_t rows = points.shape[0] + 1;
    bool are_points = points.shape[1] == 2;
    PyObject *joined = are_points ? join_points(arguments[0], &points) : NULL;
    close_array(&points);
    if (!are_points) PyErr_SetString(PyExc_ValueError, "expected points (N, 2)");
    PyObject *line = joined ? build_measured_line(joined) : NULL;
    PyObject *stations = line ? PyObject_GetAttrString(line, "s") : NULL;
    PyObject *when = stations ? new_doubles(1, &rows, &times) : NULL;
    double last_speed = 0.0;
    if (when) {
        for (Py_ssize_t i = 0; i < rows; i++) times[i] = (double)i * interval_s;
        if (!open_doubles(stations, 1, &s)) {
            Py_DecRef(when), when = NULL;
        } else {
            if (rows > 1) last_speed = (doubles(&s)[rows - 1] - doubles(&s)[rows - 2]) / interval_s;
            close_array(&s);
        }
    }
    if (stations) Py_DecRef(stations);
    if (when) return build_instance(&ANNOUNCED_TRAJECTORY, &TRAJECTORY, (PyObject *[]){line, when, PyFloat_FromDouble(last_speed)});
    if (line) Py_DecRef(line);
    return NULL;
}

/* Points every INTERVAL_S after a time. */
static PyObject *list_points(const Trajectory *trajectory, double start_s) {
    double *points;
    PyObject *array = new_doubles(2, (Py_ssize_t[]){POINTS, 2}, &points);
    for (Py_ssize_t i = 0; array && i < POINTS; i++) {
        Point point = find_point(trajectory, start_s + (double)(i + 1) * INTERVAL_S);
        points[2 * i] = point.x, points[2 * i + 1] = point.y;
    }
    return array;
}

static bool read_yaw(PyObject *mcm, double *yaw) {
    PyObject *pose = get_field(mcm, &MCM, 0);
    bool is_read = pose && read_number_field(pose, &POSE, 0, yaw);
    if (pose) Py_DecRef(pose);
    return is_read;
}

static PyObject *build_member(PyObject *id, PyObject *mcm, const Trajectory *planned, const Trajectory *desired, double age_s) {
    double yaw, speed;
    if (!read_yaw(mcm, &yaw) || !read_number_field(mcm, &MCM, 1, &speed)) return NULL;
    Point now = find_point(planned, age_s), later = find_point(planned, age_s + INTERVAL_S);
    later.x -= now.x, later.y -= now.y;
    double moved = portable_hypot(later.x, later.y);
    if (moved > 0.1 && age_s > 0) yaw = portable_atan2(later.y, later.x);
    if (age_s > 0) speed = moved / INTERVAL_S;
    double since_s = find_time(desired, compute_travelled(planned, age_s), age_s);
    PyObject *values[] = {new_reference(id),
                          PyFloat_FromDouble(now.x),
                          PyFloat_FromDouble(now.y),
                          PyFloat_FromDouble(yaw),
                          PyFloat_FromDouble(speed),
                          get_field(mcm, &MCM, 2),
                          get_field(mcm, &MCM, 3),
                          PyFloat_FromDouble(INTERVAL_S),
                          list_points(desired, since_s),
                          list_points(planned, age_s),
                          PyFloat_FromDouble(0.0),
                          PyFloat_FromDouble(0.0)};
    return build_instance(&NEGOTIATION_MEMBER, &MEMBER, values);
}

static PyObject *negotiation_announcement_predict_member(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double age_s;
    if (!expect_arguments("predict_member", count, 3, 3) || !read_number(arguments[2], &age_s)) return NULL;
    PyObject *parts[3] = {0}, *result = NULL;
    for (int i = 0; i < 3; i++) parts[i] = get_field(arguments[1], &ANNOUNCED, i);
    Trajectory planned, desired;
    if (parts[0] && parts[1] && parts[2] && open_trajectory(parts[1], &planned)) {
        if (open_trajectory(parts[2], &desired)) {
            result = build_member(arguments[0], parts[0], &planned, &desired, age_s);
            close_trajectory(&desired);
        }
        close_trajectory(&planned);
    }
    for (int i = 0; i < 3; i++)
        if (parts[i]) Py_DecRef(parts[i]);
    return result;
}

static PyObject *negotiation_announcement_predict_poses(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double age_s, yaw, *poses;
    Trajectory trajectory;
    if (!expect_arguments("predict_poses", count, 3, 3) || !read_number(arguments[1], &age_s) ||
        !read_number(arguments[2], &yaw) || !open_trajectory(arguments[0], &trajectory))
        return NULL;
    PyObject *array = new_doubles(2, (Py_ssize_t[]){TIMES, 3}, &poses);
    for (Py_ssize_t row = 0; array && row < TIMES; row++) {
        double t = age_s + get_time(row);
        Point here = find_point(&trajectory, t), ahead = find_point(&trajectory, t + INTERVAL_S);
        double dx = ahead.x - here.x, dy = ahead.y - here.y;
        if (portable_hypot(dx, dy) > 0.05) yaw = portable_atan2(dy, dx);
        poses[3 * row] = here.x, poses[3 * row + 1] = here.y, poses[3 * row + 2] = yaw;
    }
    close_trajectory(&trajectory);
    return array;
}

static void brake(const double *poses, const MotionParameters *parameters, double speed, double *braked) {
    double s[TIMES], yaws[TIMES], first = predict_yielding(parameters, speed, 0);
    s[0] = 0.0;
    for (Py_ssize_t row = 1; row < TIMES; row++) {
        const double *before = poses + 3 * (row - 1), *now = poses + 3 * row;
        double step = portable_hypot(now[0] - before[0], now[1] - before[1]);
        s[row] = row > 1 ? s[row - 1] + step : step;
    }
    for (Py_ssize_t row = 0; row < TIMES; row++) yaws[row] = poses[3 * row + 2];
    unwrap_angles(yaws, TIMES);
    for (Py_ssize_t row = 0; row < TIMES; row++) {
        double travelled = predict_yielding(parameters, speed, row) - first;
        if (s[row] < travelled) travelled = s[row];
        braked[3 * row] = interpolate(travelled, s, poses, 3, TIMES);
        braked[3 * row + 1] = interpolate(travelled, s, poses + 1, 3, TIMES);
        braked[3 * row + 2] = interpolate(travelled, s, yaws, 1, TIMES);
    }
}

static PyObject *negotiation_announcement_predict_braking(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    MotionParameters parameters;
    double speed, *braked;
    Array poses;
    if (!expect_arguments("predict_braking", count, 2, 2) || !read_motion_parameters(&parameters) ||
        !read_number(arguments[1], &speed) || !open_doubles(arguments[0], 2, &poses))
        return NULL;
    PyObject *array = NULL;
    if (poses.shape[0] != TIMES || poses.shape[1] != 3) PyErr_SetString(PyExc_ValueError, "expected a pose for each time");
    else if ((array = new_doubles(2, (Py_ssize_t[]){TIMES, 3}, &braked))) brake(doubles(&poses), &parameters, speed, braked);
    close_array(&poses);
    return array;
}

Functions negotiation_announcement = {
    FUNCTION(negotiation_announcement_measure_trajectory),
    FUNCTION(negotiation_announcement_predict_member),
    FUNCTION(negotiation_announcement_predict_poses),
    FUNCTION(negotiation_announcement_predict_braking),
    END_OF_FUNCTIONS,
};
