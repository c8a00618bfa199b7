/* Footprints along a path and sets of boxes for other C files of planning: the twins of path_overlap.py. */
#ifndef MDRIVE_PATH_OVERLAP_H
#define MDRIVE_PATH_OVERLAP_H

#include "../core/geometry.h"
#include "reference_path.h"

static inline const int64_t *integers(const Array *array) { return array->data; }
static inline const bool *flags(const Array *array) { return array->data; }
static inline const Box *boxes_of(const Array *array) { return array->data; }

/* A field of an object as an array with so many dimensions. */
bool open_field(PyObject *object, Fields *fields, int field, char kind, int dimensions, Array *array);
bool read_number_field(PyObject *object, Fields *fields, int field, double *number);
bool read_integer_field(PyObject *object, Fields *fields, int field, Py_ssize_t *number);
/* Corners (K, 4, 2). */
bool open_boxes(PyObject *object, Array *array);

/* The arrays of a ReferencePath, all with `count` rows. */
typedef struct {
    Array xy, yaw, body_yaw;
    Py_ssize_t count;
} Path;
bool open_path(PyObject *object, Path *path);
void close_path(Path *path);
static inline double get_length(const Path *path) { return (double)(path->count - 1) * SPACING_M; }

/* As path_overlap.find_cells, of one station; NaN is cell 0. */
static inline Py_ssize_t find_cell(const Path *path, double s) {
    double cell = round_even(s / SPACING_M), last = (double)(path->count - 1);
    return (Py_ssize_t)(cell > 0.0 ? cell < last ? cell : last : 0.0);
}

/* As the element of numpy.arange(start, stop, step), and how many it has; step > 0. */
static inline double get_range_element(double start, double step, Py_ssize_t i) {
    return i == 1 ? start + step : start + (double)i * ((start + step) - start);
}
static inline Py_ssize_t count_range(double start, double stop, double step) {
    double count = ceil((stop - start) / step);
    return count > 0.0 ? count < 1e7 ? (Py_ssize_t)count : 10000000 : 0;
}

/* As numpy.interp of one x, between y[0], y[step], ...; count >= 1 */
static inline double interpolate(double x, const double *xs, const double *y, Py_ssize_t step, Py_ssize_t count) {
    if (x != x && count > 1) return x;
    if (x < xs[0]) return y[0];
    if (!(x < xs[count - 1])) return y[(count - 1) * step];
    Py_ssize_t low = 0, high = count - 1; /* xs[low] <= x < xs[high] */
    while (high - low > 1) {
        Py_ssize_t middle = (low + high) / 2;
        if (xs[middle] <= x) low = middle;
        else high = middle;
    }
    double before = y[low * step], after = y[(low + 1) * step];
    if (xs[low] == x) return before;
    double slope = (after - before) / (xs[low + 1] - xs[low]), value = slope * (x - xs[low]) + before;
    if (value == value) return value;
    value = slope * (x - xs[low + 1]) + after;
    return value != value && before == after ? before : value;
}
/* As numpy.unwrap, in place. */
void unwrap_angles(double *angles, Py_ssize_t count);

/* As geometry.box_corners; a yaw that is not finite is an error. */
bool place_box(double x, double y, double yaw, double length, double width, Box *box);
/* The boxes of the own car in cells: path_overlap.compute_footprints. A cell beyond the path is an error. */
bool place_footprints(const Path *path, const int64_t *cells, Py_ssize_t count, double length, double width, Box *boxes);

/* Boxes with circles around each of them, and around each CHUNK of them: successive boxes lie along a path. */
enum { CHUNK = 16 };
typedef struct {
    double x, y, radius;
} Circle;
typedef struct {
    Py_ssize_t count;
    const Box *boxes; /* not owned */
    Circle *circles, *chunks;
} BoxSet;
bool measure_boxes(BoxSet *set, const Box *boxes, Py_ssize_t count);
void release_boxes(BoxSet *set);
/* The rows of a set that overlap a box, into rows[set->count]; their number. */
Py_ssize_t find_overlapping(const BoxSet *set, const Box *box, const Circle *circle, Py_ssize_t *rows);

/* Circles that touch up to rounding count as near. Its complement is certain: NaN is near. */
static inline bool are_near(const Circle *a, const Circle *b) {
    double dx = a->x - b->x, dy = a->y - b->y, reach = a->radius + b->radius;
    return dx * dx + dy * dy <= reach * reach * (1.0 + 1e-9);
}
static inline Circle measure_box(const Box *box) {
    double x = (box->corner[0].x + box->corner[2].x) / 2, y = (box->corner[0].y + box->corner[2].y) / 2;
    return (Circle){x, y, portable_hypot(box->corner[0].x - x, box->corner[0].y - y)};
}
#endif
