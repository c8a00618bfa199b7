/* Twins of geometry.py. */
#include "geometry.h"

static PyObject *refuse_angle(void) {
    PyErr_SetString(PyExc_ValueError, "expected finite angles, found NaN or infinity");
    return NULL;
}

bool broadcast_shape(Broadcast *shape, const Array *array, int inner) {
    int outer = array->dimensions - inner, more = outer - shape->dimensions;
    if (outer < 0) {
        PyErr_Format(PyExc_ValueError, "expected at least %d dimensions, found %d", inner, array->dimensions);
        return false;
    }
    if (more > 0) {
        for (int i = shape->dimensions - 1; i >= 0; i--) shape->shape[i + more] = shape->shape[i];
        for (int i = 0; i < more; i++) shape->shape[i] = 1;
        shape->dimensions = outer;
    }
    for (int i = 0; i < outer; i++) {
        Py_ssize_t *wanted = shape->shape + shape->dimensions - outer + i, found = array->shape[i];
        if (*wanted == 1) *wanted = found;
        if (found != 1 && found != *wanted) {
            PyErr_Format(PyExc_ValueError, "expected shapes that broadcast, found %zd beside %zd", found, *wanted);
            return false;
        }
    }
    shape->count = 1;
    for (int i = 0; i < shape->dimensions; i++) shape->count *= shape->shape[i];
    return true;
}

Steps find_steps(const Broadcast *shape, const Array *array, int inner) {
    Steps steps = {{0}};
    int outer = array->dimensions - inner;
    Py_ssize_t step = 1;
    for (int i = outer - 1; i >= 0; i--) {
        steps.step[shape->dimensions - outer + i] = array->shape[i] == 1 ? 0 : step;
        step *= array->shape[i];
    }
    return steps;
}

static PyObject *core_geometry_wrap_angle(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double angle;
    if (!expect_arguments("wrap_angle", count, 1, 1) || !read_number(arguments[0], &angle)) return NULL;
    return isinf(angle) ? refuse_angle() : PyFloat_FromDouble(wrap_angle(angle));
}

static PyObject *core_geometry_wrap_angles(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Array angles;
    if (!expect_arguments("wrap_angles", count, 1, 1) || !open_array(arguments[0], 'd', &angles)) return NULL;
    double *wrapped;
    PyObject *result = new_doubles(angles.dimensions, angles.shape, &wrapped);
    for (Py_ssize_t i = 0; result && i < angles.count; i++) wrapped[i] = wrap_half_open(doubles(&angles)[i]);
    close_array(&angles);
    return result;
}

static PyObject *core_geometry_box_corners(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double values[5];
    if (!expect_arguments("box_corners", count, 5, 5) || !read_numbers(arguments, 5, values)) return NULL;
    CosSin direction = cos_sin(values[2]);
    if (!isfinite(direction.cos)) return refuse_angle();
    double *data;
    PyObject *corners = new_doubles(2, (Py_ssize_t[]){4, 2}, &data);
    if (corners) *(Box *)data = list_corners(values[0], values[1], direction.cos, direction.sin, values[3], values[4]);
    return corners;
}

/* x, y, yaw, length and width of boxes that broadcast. */
enum { PARAMETERS = 5 };

static PyObject *build_boxes(const Array *columns, const Broadcast *shape) {
    Broadcast corners = *shape;
    if (shape->dimensions > MOST_DIMENSIONS - 2) {
        PyErr_SetString(PyExc_ValueError, "expected boxes with fewer dimensions");
        return NULL;
    }
    corners.shape[shape->dimensions] = 4, corners.shape[shape->dimensions + 1] = 2;
    double *data;
    PyObject *result = new_doubles(shape->dimensions + 2, corners.shape, &data);
    Box *boxes = (Box *)data;
    Steps steps[PARAMETERS];
    for (int k = 0; k < PARAMETERS; k++) steps[k] = find_steps(shape, columns + k, 0);
    for (Py_ssize_t i = 0; result && i < shape->count; i += get_run(shape)) {
        const double *from[PARAMETERS];
        for (int k = 0; k < PARAMETERS; k++) from[k] = doubles(columns + k) + find_run(shape, steps + k, i);
        for (Py_ssize_t j = 0; j < get_run(shape); j++) {
            boxes[i + j] = box_corners(*from[0], *from[1], *from[2], *from[3], *from[4]);
            for (int k = 0; k < PARAMETERS; k++) from[k] += get_last_step(shape, steps + k);
        }
    }
    return result;
}

static PyObject *core_geometry_boxes_corners(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("boxes_corners", count, PARAMETERS, PARAMETERS)) return NULL;
    Array columns[PARAMETERS];
    Broadcast shape = {0, {0}, 1};
    int opened = 0;
    bool are_usable = true;
    while (are_usable && opened < PARAMETERS) {
        are_usable = open_array(arguments[opened], 'd', columns + opened);
        if (are_usable) are_usable = broadcast_shape(&shape, columns + opened++, 0);
    }
    for (Py_ssize_t i = 0; are_usable && i < columns[2].count; i++)
        if (!isfinite(cos_sin(doubles(columns + 2)[i]).cos)) are_usable = (refuse_angle(), false);
    PyObject *result = are_usable ? build_boxes(columns, &shape) : NULL;
    for (int k = 0; k < opened; k++) close_array(columns + k);
    return result;
}

static PyObject *compare_boxes(const Array *first, const Array *second) {
    Broadcast shape = {0, {0}, 1};
    for (const Array *boxes = first; boxes; boxes = boxes == first ? second : NULL) {
        const Py_ssize_t *inner = boxes->shape + boxes->dimensions - 2;
        if (boxes->dimensions < 2 || inner[0] != 4 || inner[1] != 2) {
            PyErr_SetString(PyExc_ValueError, "expected corners (..., 4, 2) of boxes");
            return NULL;
        }
        if (!broadcast_shape(&shape, boxes, 2)) return NULL;
    }
    bool *overlap;
    PyObject *result = new_array('?', shape.dimensions, shape.shape, (void **)&overlap);
    Steps one = find_steps(&shape, first, 2), other = find_steps(&shape, second, 2);
    for (Py_ssize_t i = 0; result && i < shape.count; i += get_run(&shape)) {
        const Box *a = (const Box *)first->data + find_run(&shape, &one, i);
        const Box *b = (const Box *)second->data + find_run(&shape, &other, i);
        for (Py_ssize_t j = 0; j < get_run(&shape); j++)
            overlap[i + j] = boxes_overlap(a + j * get_last_step(&shape, &one), b + j * get_last_step(&shape, &other));
    }
    return result;
}

static PyObject *core_geometry_boxes_overlap(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Array first, second;
    if (!expect_arguments("boxes_overlap", count, 2, 2) || !open_array(arguments[0], 'd', &first)) return NULL;
    PyObject *result = NULL;
    if (open_array(arguments[1], 'd', &second)) {
        result = compare_boxes(&first, &second);
        close_array(&second);
    }
    close_array(&first);
    return result;
}

Py_ssize_t find_segment(const Segment *segments, Py_ssize_t count, double s) {
    Py_ssize_t low = 0, high = count; /* as bisect_right; NaN lies behind all */
    while (low < high) {
        Py_ssize_t middle = (low + high) / 2;
        if (s < segments[middle].begin) high = middle;
        else low = middle + 1;
    }
    return low > 1 ? low - 1 : 0;
}

Point compute_point(const Segment *segments, Py_ssize_t count, double s) {
    Segment on = segments[find_segment(segments, count, s)];
    double length = on.length < 1e-12 ? 1e-12 : on.length;
    return (Point){on.x + (s - on.begin) * (on.dx / length), on.y + (s - on.begin) * (on.dy / length)};
}

Frenet project_on_segments(const Segment *segments, Py_ssize_t count, double x, double y, double low, double high) {
    double least = INFINITY;
    Frenet nearest = {NAN, NAN};
    Py_ssize_t last = find_segment(segments, count, high);
    for (Py_ssize_t i = find_segment(segments, count, low); i <= last; i++) {
        Segment on = segments[i];
        double ahead = x - on.x, left = y - on.y, square_length = on.length * on.length;
        double share = (ahead * on.dx + left * on.dy) / (square_length < 1e-18 ? 1e-18 : square_length);
        share = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
        double gap_x = ahead - share * on.dx, gap_y = left - share * on.dy, square = gap_x * gap_x + gap_y * gap_y;
        if (square < least) {
            least = square;
            nearest = (Frenet){on.begin + share * on.length, copysign(sqrt(square), on.dx * left - on.dy * ahead)};
        }
    }
    return nearest;
}

static bool open_segments(PyObject *object, Array *segments) {
    if (!open_doubles(object, 2, segments)) return false;
    if (segments->shape[0] && segments->shape[1] == sizeof(Segment) / sizeof(double)) return true;
    close_array(segments);
    PyErr_SetString(PyExc_ValueError, "expected one row or more of six numbers for the segments of a polyline");
    return false;
}

static PyObject *core_geometry__find_segment(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double s;
    Array segments;
    if (!expect_arguments("find_segment", count, 2, 2) || !read_number(arguments[1], &s)) return NULL;
    if (!open_segments(arguments[0], &segments)) return NULL;
    Py_ssize_t row = find_segment(segments.data, segments.shape[0], s);
    close_array(&segments);
    return PyLong_FromSsize_t(row);
}

static PyObject *core_geometry__compute_point(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double s;
    Array segments;
    if (!expect_arguments("compute_point", count, 2, 2) || !read_number(arguments[1], &s)) return NULL;
    if (!open_segments(arguments[0], &segments)) return NULL;
    Point point = compute_point(segments.data, segments.shape[0], s);
    close_array(&segments);
    return build_tuple(2, (double[]){point.x, point.y});
}

static PyObject *core_geometry__project_on_segments(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double v[4];
    Array segments;
    if (!expect_arguments("project_on_segments", count, 5, 5) || !read_numbers(arguments + 1, 4, v)) return NULL;
    if (!open_segments(arguments[0], &segments)) return NULL;
    Frenet nearest = project_on_segments(segments.data, segments.shape[0], v[0], v[1], v[2], v[3]);
    close_array(&segments);
    return build_tuple(2, (double[]){nearest.s, nearest.d});
}

Functions core_geometry = {
    FUNCTION(core_geometry_wrap_angle),
    FUNCTION(core_geometry_wrap_angles),
    FUNCTION(core_geometry_box_corners),
    FUNCTION(core_geometry_boxes_corners),
    FUNCTION(core_geometry_boxes_overlap),
    FUNCTION(core_geometry__find_segment),
    FUNCTION(core_geometry__compute_point),
    FUNCTION(core_geometry__project_on_segments),
    END_OF_FUNCTIONS,
};
