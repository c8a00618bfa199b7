/* Twins of intention.py. */
#include "intention.h"

#include <string.h>

FIELDS(LINE, "points", "s", "direction");
FIELDS(PARAMETERS, "turn_rad", "lane_m");
FIELDS(DIRECTIONS, "FOLLOW", "LEFT", "RIGHT", "CHANGE_LEFT", "CHANGE_RIGHT");
enum { FOLLOW, LEFT, RIGHT, CHANGE_LEFT, CHANGE_RIGHT };
static Import MEASURED_LINE = {"mdrive_sumo.negotiation.intention", "MeasuredLine", 0};
static Import INTENTION = {"mdrive_sumo.negotiation.intention", "INTENTION", 0};
static Import DIRECTION = {"mdrive_sumo.v2x.content", "Direction", 0};

static bool open_column(PyObject *line, int field, int dimensions, Array *array) {
    PyObject *value = get_field(line, &LINE, field);
    bool is_open = value && open_doubles(value, dimensions, array);
    if (value) Py_DecRef(value);
    return is_open;
}

bool open_line(PyObject *line, Line *opened) {
    if (!open_column(line, 0, 2, &opened->points)) return false;
    if (!open_column(line, 1, 1, &opened->s)) {
        close_array(&opened->points);
        return false;
    }
    if (!open_column(line, 2, 1, &opened->direction)) {
        close_arrays(2, (Array *[]){&opened->points, &opened->s});
        return false;
    }
    opened->count = opened->s.count;
    Py_ssize_t parts = opened->direction.count;
    if (opened->count && opened->points.shape[0] == opened->count && opened->points.shape[1] == 2 && (!parts || parts == 2))
        return true;
    PyErr_SetString(PyExc_ValueError, "expected a measured line of at least one point");
    close_line(opened);
    return false;
}

void close_line(Line *line) { close_arrays(3, (Array *[]){&line->points, &line->s, &line->direction}); }

Point sample_point(const Line *line, double station) {
    const double *points = doubles(&line->points), *s = doubles(&line->s);
    Point point = {interpolate(station, s, points, 2, line->count), interpolate(station, s, points + 1, 2, line->count)};
    if (!line->direction.count) return point;
    double beyond = station - s[line->count - 1];
    if (beyond < 0.0) beyond = 0.0;
    point.x += beyond * doubles(&line->direction)[0], point.y += beyond * doubles(&line->direction)[1];
    return point;
}

/* Arc lengths (count), and the row before the last step that moves, -1 if none does. */
static Py_ssize_t measure(const double *points, Py_ssize_t count, double *s) {
    Py_ssize_t moving = -1;
    double total = 0.0;
    s[0] = 0.0;
    for (Py_ssize_t i = 0; i + 1 < count; i++) {
        double length = portable_hypot(points[2 * i + 2] - points[2 * i], points[2 * i + 3] - points[2 * i + 1]);
        total = i ? total + length : length;
        s[i + 1] = total;
        if (length > 1e-6) moving = i;
    }
    return moving;
}

static PyObject *build_direction(const double *points, Py_ssize_t moving) {
    double *direction;
    PyObject *array = new_doubles(1, (Py_ssize_t[]){moving < 0 ? 0 : 2}, &direction);
    if (!array || moving < 0) return array;
    double dx = points[2 * moving + 2] - points[2 * moving], dy = points[2 * moving + 3] - points[2 * moving + 1];
    double length = portable_hypot(dx, dy);
    direction[0] = dx / length, direction[1] = dy / length;
    return array;
}

PyObject *build_measured_line(PyObject *points) {
    Array array;
    double *s;
    if (!points || !open_doubles(points, 2, &array)) {
        if (points) Py_DecRef(points);
        return NULL;
    }
    PyObject *values[] = {points, NULL, NULL};
    if (array.shape[0] < 1 || array.shape[1] != 2) PyErr_SetString(PyExc_ValueError, "expected points (N, 2), N >= 1");
    else if ((values[1] = new_doubles(1, array.shape, &s)))
        values[2] = build_direction(doubles(&array), measure(doubles(&array), array.shape[0], s));
    close_array(&array);
    if (values[2]) return build_instance(&MEASURED_LINE, &LINE, values);
    Py_DecRef(points);
    if (values[1]) Py_DecRef(values[1]);
    return NULL;
}

static PyObject *negotiation_intention_measure_line(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    return expect_arguments("measure_line", count, 1, 1) ? build_measured_line(new_reference(arguments[0])) : NULL;
}

static PyObject *negotiation_intention_sample_line(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Line line;
    Array stations;
    if (!expect_arguments("sample_line", count, 2, 2) || !open_doubles(arguments[1], 1, &stations)) return NULL;
    if (!open_line(arguments[0], &line)) {
        close_array(&stations);
        return NULL;
    }
    double *points;
    PyObject *result = new_doubles(2, (Py_ssize_t[]){stations.count, 2}, &points);
    for (Py_ssize_t i = 0; result && i < stations.count; i++) {
        Point point = sample_point(&line, doubles(&stations)[i]);
        points[2 * i] = point.x, points[2 * i + 1] = point.y;
    }
    close_array(&stations);
    close_line(&line);
    return result;
}

/* The first and the last step that moves between every `stride`-th point; how many there are. */
static Py_ssize_t find_steps_that_move(const double *points, Py_ssize_t count, Py_ssize_t stride, Point *first, Point *last) {
    Py_ssize_t steps = 0;
    for (Py_ssize_t i = 0; i + stride < count; i += stride) {
        Point step = {points[2 * (i + stride)] - points[2 * i], points[2 * (i + stride) + 1] - points[2 * i + 1]};
        if (!(portable_hypot(step.x, step.y) > 1e-6)) continue;
        if (!steps++) *first = step;
        *last = step;
    }
    return steps;
}

static int classify(const double *points, Py_ssize_t count, double turn_rad, double lane_m) {
    Point first, last;
    Py_ssize_t stride = count / 15 > 1 ? count / 15 : 1;
    if (find_steps_that_move(points, count, stride, &first, &last) < 2) return FOLLOW;
    double start = portable_atan2(first.y, first.x), turn = wrap_angle(portable_atan2(last.y, last.x) - start);
    if (fabs(turn) > turn_rad) return turn > 0 ? LEFT : RIGHT;
    CosSin ahead = cos_sin(start);
    const double *end = points + 2 * (count - 1);
    double lateral = ahead.cos * (end[1] - points[1]) - ahead.sin * (end[0] - points[0]);
    if (fabs(lateral) > lane_m && fabs(turn) < turn_rad / 3) return lateral > 0 ? CHANGE_LEFT : CHANGE_RIGHT;
    return FOLLOW;
}

static PyObject *negotiation_intention_classify_direction(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double numbers[2];
    Array line;
    if (!expect_arguments("classify_direction", count, 1, 2)) return NULL;
    PyObject *parameters = count > 1 ? arguments[1] : find_import(&INTENTION), *directions = find_import(&DIRECTION);
    if (!parameters || !directions || !read_fields(parameters, &PARAMETERS, numbers) || !open_doubles(arguments[0], 2, &line))
        return NULL;
    bool are_points = line.shape[1] == 2;
    int direction = are_points ? classify(doubles(&line), line.shape[0], numbers[0], numbers[1]) : FOLLOW;
    close_array(&line);
    if (are_points) return get_field(directions, &DIRECTIONS, direction);
    PyErr_SetString(PyExc_ValueError, "expected points (N, 2)");
    return NULL;
}

Functions negotiation_intention = {
    FUNCTION(negotiation_intention_measure_line),
    FUNCTION(negotiation_intention_sample_line),
    FUNCTION(negotiation_intention_classify_direction),
    END_OF_FUNCTIONS,
};
