/* Twins of path_overlap.py. */
#include "path_overlap.h"

#include <stdlib.h>

FIELDS(PATH, "xy", "yaw", "body_yaw");

bool open_field(PyObject *object, Fields *fields, int field, char kind, int dimensions, Array *array) {
    PyObject *value = get_field(object, fields, field);
    if (!value) return false;
    bool is_open = open_array(value, kind, array);
    Py_DecRef(value);
    if (!is_open) return false;
    if (array->dimensions == dimensions) return true;
    PyErr_Format(PyExc_ValueError, "%s: expected an array of %d dimensions, found %d", fields->texts[field], dimensions,
                 array->dimensions);
    close_array(array);
    return false;
}

bool read_number_field(PyObject *object, Fields *fields, int field, double *number) {
    PyObject *value = get_field(object, fields, field);
    bool is_number = value && read_number(value, number);
    if (value) Py_DecRef(value);
    return is_number;
}

bool read_integer_field(PyObject *object, Fields *fields, int field, Py_ssize_t *number) {
    PyObject *value = get_field(object, fields, field);
    bool is_number = value && read_integer(value, number);
    if (value) Py_DecRef(value);
    return is_number;
}

bool open_boxes(PyObject *object, Array *array) {
    if (!open_doubles(object, 3, array)) return false;
    if (array->shape[1] == 4 && array->shape[2] == 2) return true;
    PyErr_SetString(PyExc_ValueError, "expected corners of boxes (K, 4, 2)");
    close_array(array);
    return false;
}

bool open_path(PyObject *object, Path *path) {
    if (!open_field(object, &PATH, 0, 'd', 2, &path->xy)) return false;
    if (!open_field(object, &PATH, 1, 'd', 1, &path->yaw)) {
        close_array(&path->xy);
        return false;
    }
    if (!open_field(object, &PATH, 2, 'd', 1, &path->body_yaw)) {
        close_arrays(2, (Array *[]){&path->xy, &path->yaw});
        return false;
    }
    path->count = path->xy.shape[0];
    if (path->count && path->xy.shape[1] == 2 && path->yaw.count == path->count && path->body_yaw.count == path->count)
        return true;
    PyErr_SetString(PyExc_ValueError, "expected a path of at least one point");
    close_path(path);
    return false;
}

void close_path(Path *path) { close_arrays(3, (Array *[]){&path->xy, &path->yaw, &path->body_yaw}); }

void unwrap_angles(double *angles, Py_ssize_t count) {
    double correction = 0.0, before = count ? angles[0] : 0.0;
    for (Py_ssize_t i = 1; i < count; i++) {
        double turned = angles[i] - before, wrapped = fmod(turned + PI, TAU);
        if (wrapped < 0.0) wrapped += TAU;
        wrapped = (wrapped == 0.0 ? 0.0 : wrapped) - PI; /* NumPy's mod has the sign of TAU */
        if (wrapped == -PI && turned > 0.0) wrapped = PI;
        correction += fabs(turned) < PI ? 0.0 : wrapped - turned;
        before = angles[i];
        angles[i] += correction;
    }
}

bool place_box(double x, double y, double yaw, double length, double width, Box *box) {
    CosSin direction = cos_sin(yaw);
    *box = list_corners(x, y, direction.cos, direction.sin, length, width);
    if (isfinite(direction.cos)) return true;
    PyErr_SetString(PyExc_ValueError, "expected finite angles, found NaN or infinity");
    return false;
}

bool place_footprints(const Path *path, const int64_t *cells, Py_ssize_t count, double length, double width, Box *boxes) {
    for (Py_ssize_t i = 0; i < count; i++) {
        Py_ssize_t cell = (Py_ssize_t)cells[i];
        if (cell < 0) cell += path->count; /* as NumPy: a car may begin a little before its path */
        if (cell < 0 || cell >= path->count) {
            PyErr_Format(PyExc_ValueError, "expected cells 0 to %zd, found %zd", path->count - 1, cell);
            return false;
        }
        const double *xy = doubles(&path->xy) + 2 * cell;
        if (!place_box(xy[0], xy[1], doubles(&path->body_yaw)[cell], length, width, boxes + i)) return false;
    }
    return true;
}

/* Extremes without the boxes that are no numbers: those overlap nothing. */
static Circle measure_chunk(const Circle *circles, Py_ssize_t count) {
    double low_x = INFINITY, high_x = -INFINITY, low_y = INFINITY, high_y = -INFINITY, radius = 0.0;
    for (Py_ssize_t i = 0; i < count; i++) {
        low_x = least(circles[i].x, low_x), high_x = greatest(circles[i].x, high_x);
        low_y = least(circles[i].y, low_y), high_y = greatest(circles[i].y, high_y);
        radius = greatest(circles[i].radius, radius);
    }
    double x = (low_x + high_x) / 2, y = (low_y + high_y) / 2;
    return (Circle){x, y, (portable_hypot(high_x - x, high_y - y) + radius) * (1.0 + 1e-6)};
}

bool measure_boxes(BoxSet *set, const Box *boxes, Py_ssize_t count) {
    Py_ssize_t chunks = (count + CHUNK - 1) / CHUNK;
    *set = (BoxSet){count, boxes, malloc((size_t)(count + chunks + 1) * sizeof(Circle)), NULL};
    if (!set->circles) {
        PyErr_NoMemory();
        return false;
    }
    set->chunks = set->circles + count;
    for (Py_ssize_t i = 0; i < count; i++) set->circles[i] = measure_box(boxes + i);
    for (Py_ssize_t i = 0; i < chunks; i++) {
        Py_ssize_t rest = count - i * CHUNK;
        set->chunks[i] = measure_chunk(set->circles + i * CHUNK, rest < CHUNK ? rest : CHUNK);
    }
    return true;
}

void release_boxes(BoxSet *set) { free(set->circles); }

Py_ssize_t find_overlapping(const BoxSet *set, const Box *box, const Circle *circle, Py_ssize_t *rows) {
    Py_ssize_t found = 0;
    for (Py_ssize_t start = 0; start < set->count; start += CHUNK) {
        const Circle *chunk = set->chunks + start / CHUNK;
        double dx = chunk->x - circle->x, dy = chunk->y - circle->y, reach = chunk->radius + circle->radius;
        if (dx * dx + dy * dy > reach * reach) continue; /* NaN: each box decides */
        Py_ssize_t end = start + CHUNK < set->count ? start + CHUNK : set->count;
        for (Py_ssize_t row = start; row < end; row++)
            if (are_near(set->circles + row, circle) && boxes_overlap(set->boxes + row, box)) rows[found++] = row;
    }
    return found;
}

typedef struct {
    Py_ssize_t count, size;
    int64_t *boxes, *others;
} Pairs;

static bool add_pairs(Pairs *pairs, const Py_ssize_t *rows, Py_ssize_t count, Py_ssize_t other) {
    if (pairs->count + count > pairs->size) {
        Py_ssize_t size = 2 * pairs->size + count + 64;
        int64_t *boxes = realloc(pairs->boxes, (size_t)size * sizeof *boxes);
        if (boxes) pairs->boxes = boxes;
        int64_t *others = boxes ? realloc(pairs->others, (size_t)size * sizeof *others) : NULL;
        if (!others) {
            PyErr_NoMemory();
            return false;
        }
        pairs->others = others, pairs->size = size;
    }
    for (Py_ssize_t i = 0; i < count; i++, pairs->count++)
        pairs->boxes[pairs->count] = rows[i], pairs->others[pairs->count] = other;
    return true;
}

static PyObject *build_integers(Py_ssize_t count, const int64_t *values) {
    void *data;
    PyObject *array = new_array('l', 1, &count, &data);
    for (Py_ssize_t i = 0; array && i < count; i++) ((int64_t *)data)[i] = values[i];
    return array;
}

static PyObject *list_pairs(const BoxSet *set, const Array *others) {
    Py_ssize_t *rows = malloc((size_t)(set->count + 1) * sizeof *rows);
    Pairs pairs = {0};
    bool is_listed = rows != NULL;
    if (!rows) PyErr_NoMemory();
    for (Py_ssize_t other = 0; is_listed && other < others->shape[0]; other++) {
        const Box *box = boxes_of(others) + other;
        Circle circle = measure_box(box);
        is_listed = add_pairs(&pairs, rows, find_overlapping(set, box, &circle, rows), other);
    }
    PyObject *result = NULL;
    if (is_listed)
        result = pack(2, build_integers(pairs.count, pairs.boxes), build_integers(pairs.count, pairs.others));
    free(rows), free(pairs.boxes), free(pairs.others);
    return result;
}

static PyObject *mark_overlaps(const BoxSet *set, const Array *others) {
    Py_ssize_t shape[] = {set->count, others->shape[0]};
    Py_ssize_t *rows = malloc((size_t)(set->count + 1) * sizeof *rows);
    void *data = NULL;
    PyObject *result = rows ? new_array('?', 2, shape, &data) : PyErr_NoMemory();
    bool *mask = data;
    for (Py_ssize_t i = 0; result && i < shape[0] * shape[1]; i++) mask[i] = false;
    for (Py_ssize_t other = 0; result && other < shape[1]; other++) {
        const Box *box = boxes_of(others) + other;
        Circle circle = measure_box(box);
        Py_ssize_t found = find_overlapping(set, box, &circle, rows);
        for (Py_ssize_t i = 0; i < found; i++) mask[rows[i] * shape[1] + other] = true;
    }
    free(rows);
    return result;
}

static PyObject *compare_sets(PyObject *(*compare)(const BoxSet *, const Array *), PyObject *const *arguments) {
    Array boxes, others;
    if (!open_boxes(arguments[0], &boxes)) return NULL;
    if (!open_boxes(arguments[1], &others)) {
        close_array(&boxes);
        return NULL;
    }
    BoxSet set;
    PyObject *result = NULL;
    if (measure_boxes(&set, boxes_of(&boxes), boxes.shape[0])) {
        result = compare(&set, &others);
        release_boxes(&set);
    }
    close_arrays(2, (Array *[]){&boxes, &others});
    return result;
}

static PyObject *planning_path_overlap_find_overlapping_pairs(PyObject *module, PyObject *const *arguments,
                                                              Py_ssize_t count) {
    return expect_arguments("find_overlapping_pairs", count, 2, 2) ? compare_sets(list_pairs, arguments) : NULL;
}

static PyObject *planning_path_overlap_compute_overlaps(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    return expect_arguments("compute_overlaps", count, 2, 2) ? compare_sets(mark_overlaps, arguments) : NULL;
}

Functions planning_path_overlap = {
    FUNCTION(planning_path_overlap_find_overlapping_pairs),
    FUNCTION(planning_path_overlap_compute_overlaps),
    END_OF_FUNCTIONS,
};
