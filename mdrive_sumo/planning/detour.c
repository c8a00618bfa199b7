/* Twins of detour.py. */
#include <stdlib.h>
#include <string.h>

#include "path_overlap.h"

FIELDS(PARAMETERS, "look_ahead_m", "obstructing_gap_m");
FIELDS(SIZE, "length", "width");
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

Functions planning_detour = {
    FUNCTION(planning_detour_find_obstructing_boxes),
    FUNCTION(planning_detour_to_frenet),
    END_OF_FUNCTIONS,
};
