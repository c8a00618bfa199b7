/* Twins of detour.py. */
#include <stdlib.h>
#include <string.h>

#include "path_overlap.h"

FIELDS(PARAMETERS, "look_ahead_m", "obstructing_gap_m");
FIELDS(SIZE, "length", "width");
FIELDS(SHIFT, "left", "hold", "ramps");
FIELDS(REFERENCE, "xy", "yaw", "curvature", "goal_s", "rear_to_centre", "start_yaw");
static Import REFERENCE_PATH = {"mdrive_sumo.planning.reference_path", "ReferencePath", 0};
static Import DETOUR_CLASS = {"mdrive_sumo.planning.detour", "Detour", 0};
static Import DETOUR = {"mdrive_sumo.planning.parameters", "DETOUR", 0};

/* The own boxes at every second point of the path from s on, up to look_ahead_m. */
static Box *place_ahead(const Path *path, double s, const double *parameters, const double *size, Py_ssize_t *count) {
    double end = s + parameters[0];
    if (get_length(path) < end) end = get_length(path);
    *count = count_range(s, end, 2 * SPACING_M);
    Box *boxes = malloc((size_t)(*count + 1) * sizeof *boxes);
    if (!boxes) PyErr_NoMemory();
    for (Py_ssize_t i = 0; boxes && i < *count; i++) {
        int64_t cell = find_cell(path, get_range_element(s, 2 * SPACING_M, i));
        if (place_footprints(path, &cell, 1, size[0], size[1] + 2 * parameters[1], boxes + i)) continue;
        free(boxes);
        boxes = NULL;
    }
    return boxes;
}

static PyObject *mark_obstructing(const Path *path, double s, const Array *boxes, const double *parameters, const double *size) {
    Py_ssize_t count;
    Box *mine = place_ahead(path, s, parameters, size, &count);
    Py_ssize_t *rows = mine ? malloc((size_t)(count + 1) * sizeof *rows) : NULL;
    BoxSet set = {0};
    void *mask = NULL;
    PyObject *result = NULL;
    if (mine && !rows) PyErr_NoMemory();
    if (rows && measure_boxes(&set, mine, count)) result = new_array('?', 1, boxes->shape, &mask);
    for (Py_ssize_t i = 0; result && i < boxes->shape[0]; i++) {
        Circle circle = measure_box(boxes_of(boxes) + i);
        ((bool *)mask)[i] = find_overlapping(&set, boxes_of(boxes) + i, &circle, rows) > 0;
    }
    release_boxes(&set);
    free(rows), free(mine);
    return result;
}

static PyObject *planning_detour_find_obstructing_boxes(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double s, size[2], numbers[2];
    Array boxes;
    Path path;
    if (!expect_arguments("find_obstructing_boxes", count, 4, 5) || !read_number(arguments[1], &s)) return NULL;
    PyObject *parameters = count > 4 ? arguments[4] : find_import(&DETOUR), *result = NULL;
    if (!parameters || !read_fields(parameters, &PARAMETERS, numbers) || !read_fields(arguments[3], &SIZE, size) ||
        !open_boxes(arguments[2], &boxes))
        return NULL;
    if (open_path(arguments[0], &path)) {
        result = mark_obstructing(&path, s, &boxes, numbers, size);
        close_path(&path);
    }
    close_array(&boxes);
    return result;
}

static Py_ssize_t find_nearest(const Point *chain, Py_ssize_t count, Point point) {
    Py_ssize_t nearest = 0;
    double least_square = INFINITY;
    for (Py_ssize_t i = 0; i < count; i++) {
        double dx = point.x - chain[i].x, dy = point.y - chain[i].y, square = dx * dx + dy * dy;
        if (square < least_square) least_square = square, nearest = i;
    }
    return nearest;
}

static PyObject *locate_points(const Array *chain, const Array *yaw, const Array *points) {
    void *nearest;
    double *ahead, *left;
    int outer = points->dimensions - 1;
    PyObject *values[] = {new_array('l', outer, points->shape, &nearest), new_doubles(outer, points->shape, &ahead),
                          new_doubles(outer, points->shape, &left)};
    bool are_made = values[0] && values[1] && values[2];
    for (Py_ssize_t k = 0; are_made && k < points->count / 2; k++) {
        Point point = ((const Point *)points->data)[k];
        Py_ssize_t i = find_nearest(chain->data, chain->shape[0], point);
        double dx = point.x - doubles(chain)[2 * i], dy = point.y - doubles(chain)[2 * i + 1];
        CosSin direction = cos_sin(doubles(yaw)[i]);
        ((int64_t *)nearest)[k] = i;
        ahead[k] = dx * direction.cos + dy * direction.sin, left[k] = dy * direction.cos - dx * direction.sin;
    }
    return pack(3, values[0], values[1], values[2]);
}

static PyObject *planning_detour_to_frenet(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Array chain, yaw, points;
    if (!expect_arguments("to_frenet", count, 3, 3) || !open_doubles(arguments[0], 2, &chain)) return NULL;
    if (!open_doubles(arguments[1], 1, &yaw)) {
        close_array(&chain);
        return NULL;
    }
    if (!open_array(arguments[2], 'd', &points)) {
        close_arrays(2, (Array *[]){&chain, &yaw});
        return NULL;
    }
    PyObject *result = NULL;
    bool are_points = points.dimensions >= 2 && points.shape[points.dimensions - 1] == 2;
    if (are_points && chain.shape[1] == 2 && yaw.count == chain.shape[0] && yaw.count)
        result = locate_points(&chain, &yaw, &points);
    else
        PyErr_SetString(PyExc_ValueError, "expected a chain of points with directions, and points (K, ..., 2)");
    close_arrays(3, (Array *[]){&chain, &yaw, &points});
    return result;
}

/* A path that is shifted and measured anew: points (count, 2), their arc lengths, the stations that they had. */
typedef struct {
    Py_ssize_t count;
    Point *points;
    double *s, *stations;
} Chain;

/* As _LateralShift.evaluate: left, both stations of hold, both ramps. */
static double evaluate_shift(const double *shift, double s) {
    double rise = (s - shift[1] + shift[3]) / shift[3], fall = (shift[2] + shift[4] - s) / shift[4];
    double u = fall < rise || isnan(fall) ? fall : rise; /* NaN stays NaN */
    u = u < 0.0 ? 0.0 : u > 1.0 ? 1.0 : u;
    return shift[0] * (u * u * u) * (10 - 15 * u + 6 * (u * u));
}

/* The shifted points of a path, without those that lie where the one before lies. */
static bool shift_points(const Path *path, const double *shift, Chain *chain) {
    Point before = {0.0, 0.0};
    double total = 0.0;
    for (Py_ssize_t i = 0; i < path->count; i++) {
        CosSin direction = cos_sin(doubles(&path->yaw)[i]);
        double left = evaluate_shift(shift, (double)i * SPACING_M);
        Point point = {doubles(&path->xy)[2 * i] + left * -direction.sin,
                       doubles(&path->xy)[2 * i + 1] + left * direction.cos};
        if (!isfinite(point.x) || !isfinite(point.y)) return false;
        double step = portable_hypot(point.x - before.x, point.y - before.y);
        before = point;
        if (i && !(step > 1e-6)) continue;
        Py_ssize_t k = chain->count++;
        chain->points[k] = point, chain->stations[k] = (double)k * SPACING_M;
        if (k) {
            double length = portable_hypot(point.x - chain->points[k - 1].x, point.y - chain->points[k - 1].y);
            total = k > 1 ? total + length : length;
        }
        chain->s[k] = total;
    }
    return chain->count > 1;
}

/* How many points SPACING_M apart a chain of that length has before its end, as Polyline.stations. */
static Py_ssize_t count_stations(double length) {
    Py_ssize_t count = count_range(0.0, length, SPACING_M);
    return count > 1 && length - (double)(count - 1) * SPACING_M < 0.1 * SPACING_M ? count - 1 : count;
}

static void resample(const Chain *chain, Py_ssize_t count, double *xy) {
    Py_ssize_t low = 0;
    for (Py_ssize_t i = 0; i < count; i++) {
        double s = (double)i * SPACING_M;
        while (low + 2 < chain->count && chain->s[low + 1] <= s) low++;
        Point before = chain->points[low], after = chain->points[low + 1];
        double ahead_m = s - chain->s[low], length = chain->s[low + 1] - chain->s[low];
        bool is_there = chain->s[low] == s;
        xy[2 * i] = is_there ? before.x : (after.x - before.x) / length * ahead_m + before.x;
        xy[2 * i + 1] = is_there ? before.y : (after.y - before.y) / length * ahead_m + before.y;
    }
}

/* As numpy.gradient of every second number, at one of them. */
static double measure_gradient(const double *xy, Py_ssize_t count, Py_ssize_t i) {
    if (!i) return xy[2] - xy[0];
    return i == count - 1 ? xy[2 * i] - xy[2 * i - 2] : (xy[2 * i + 2] - xy[2 * i - 2]) / 2.0;
}

static void direct(const double *xy, Py_ssize_t count, double *yaw, double *curvature) {
    enum { REACH = 4 }; /* points in a metre */
    for (Py_ssize_t i = 0; i < count; i++)
        yaw[i] = portable_atan2(measure_gradient(xy + 1, count, i), measure_gradient(xy, count, i));
    unwrap_angles(yaw, count);
    for (Py_ssize_t i = 0; i < count; i++) {
        Py_ssize_t low = i > REACH ? i - REACH : 0, high = i + REACH < count ? i + REACH : count - 1;
        curvature[i] = (yaw[high] - yaw[low]) / (2 * REACH * SPACING_M);
    }
}

static PyObject *build_path(const Chain *chain, double goal_s, double rear_to_centre, double start_yaw) {
    Py_ssize_t count = count_stations(chain->s[chain->count - 1]);
    double *xy, *yaw, *curvature;
    if (count < 2) {
        PyErr_SetString(PyExc_ValueError, "expected a path of at least two points");
        return NULL;
    }
    PyObject *values[] = {new_doubles(2, (Py_ssize_t[]){count, 2}, &xy), new_doubles(1, &count, &yaw),
                          new_doubles(1, &count, &curvature), PyFloat_FromDouble(goal_s),
                          PyFloat_FromDouble(rear_to_centre),    PyFloat_FromDouble(start_yaw)};
    if (values[0] && values[1] && values[2]) {
        resample(chain, count, xy);
        direct(xy, count, yaw, curvature);
    }
    return build_instance(&REFERENCE_PATH, &REFERENCE, values);
}

static PyObject *build_detour(const Path *path, const double *shift, double goal_s, double rear_to_centre) {
    PyObject *class = find_import(&DETOUR_CLASS), *result = NULL;
    size_t points = (size_t)path->count;
    Chain chain = {0, malloc(points * sizeof(Point)), malloc(points * sizeof(double)), malloc(points * sizeof(double))};
    if (!chain.points || !chain.s || !chain.stations) {
        PyErr_NoMemory();
    } else if (!shift_points(path, shift, &chain)) {
        PyErr_SetString(PyExc_ValueError, "expected a path of finite points that differ");
    } else if (class) {
        double stations[] = {goal_s, shift[1] - shift[3], shift[2] + shift[4]};
        for (int i = 0; i < 3; i++) stations[i] = interpolate(stations[i], chain.stations, chain.s, 1, chain.count);
        PyObject *shifted = build_path(&chain, stations[0], rear_to_centre, doubles(&path->body_yaw)[0]);
        PyObject *first_s = PyFloat_FromDouble(stations[1]), *last_s = PyFloat_FromDouble(stations[2]);
        if (shifted && first_s && last_s) result = PyObject_CallFunctionObjArgs(class, shifted, first_s, last_s, NULL);
        if (shifted) Py_DecRef(shifted);
        if (first_s) Py_DecRef(first_s);
        if (last_s) Py_DecRef(last_s);
    }
    free(chain.points), free(chain.s), free(chain.stations);
    return result;
}

static bool read_shift(PyObject *shift, double *numbers) {
    bool is_read = read_number_field(shift, &SHIFT, 0, numbers);
    for (int i = 0; is_read && i < 4; i++) {
        PyObject *pair = get_field(shift, &SHIFT, 1 + i / 2), *value = pair ? PySequence_GetItem(pair, i % 2) : NULL;
        is_read = value && read_number(value, numbers + 1 + i);
        if (value) Py_DecRef(value);
        if (pair) Py_DecRef(pair);
    }
    return is_read;
}

static PyObject *planning_detour_apply_shift(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double shift[5], goal_s, rear_to_centre;
    Path path;
    if (!expect_arguments("apply_shift", count, 3, 3) || !read_shift(arguments[1], shift) ||
        !read_number_field(arguments[0], &REFERENCE, 3, &goal_s) || !read_number(arguments[2], &rear_to_centre) ||
        !open_path(arguments[0], &path))
        return NULL;
    PyObject *result = build_detour(&path, shift, goal_s, rear_to_centre);
    close_path(&path);
    return result;
}

Functions planning_detour = {
    FUNCTION(planning_detour_find_obstructing_boxes),
    FUNCTION(planning_detour_to_frenet),
    FUNCTION(planning_detour_apply_shift),
    END_OF_FUNCTIONS,
};
