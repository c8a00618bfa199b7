/* Twins of visibility.py; each eye costs time in proportion to the pieces of edges around it. */
#include "visibility.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/geometry.h"

static const double TIE = 1e-9, FLAT = 1e-9, LOW_M = 2.5;
FIELDS(EYE, "x", "y", "yaw", "carrier_row");
FIELDS(BUILDINGS, "walls", "ends", "circles");

bool read_eye(PyObject *pose, Eye *eye) {
    double *numbers[] = {&eye->x, &eye->y, &eye->yaw};
    for (int i = 0; i < 3; i++) {
        PyObject *value = get_field(pose, &EYE, i);
        bool is_number = value && read_number(value, numbers[i]);
        if (value) Py_DecRef(value);
        if (!is_number) return false;
    }
    PyObject *row = get_field(pose, &EYE, 3);
    if (!row) return false;
    eye->carrier_row = -1;
    bool is_valid = row == Py_None || read_integer(row, &eye->carrier_row);
    Py_DecRef(row);
    return is_valid;
}

/* As measure_distances, of one box whose direction is known. */
static double measure_distance(const RoadUsers *boxes, Py_ssize_t row, CosSin yaw, Eye eye) {
    double dx = x_of(boxes)[row] - eye.x, dy = y_of(boxes)[row] - eye.y;
    double ahead = fabs(yaw.cos * dx + yaw.sin * dy) - lengths_of(boxes)[row] / 2;
    double aside = fabs(yaw.cos * dy - yaw.sin * dx) - widths_of(boxes)[row] / 2;
    return portable_hypot(0.0 > ahead ? 0.0 : ahead, 0.0 > aside ? 0.0 : aside);
}

static bool add_edge(Sight *sight, Point start, Point end, Py_ssize_t box, bool hides) {
    Point p = {start.x - sight->eye.x, start.y - sight->eye.y}, q = {end.x - sight->eye.x, end.y - sight->eye.y};
    double double_area = p.x * q.y - p.y * q.x;
    if (!(double_area < -FLAT)) return true;
    double left = portable_atan2(p.y, p.x), right = portable_atan2(q.y, q.x);
    if (isnan(left) || isnan(right)) {
        PyErr_SetString(PyExc_ValueError, "expected finite corners of boxes and buildings");
        return false;
    }
    double extent = left - right; /* in [-2 pi, 2 pi] */
    if (extent < 0.0) extent += TAU;
    else if (extent >= TAU) extent = 0.0;
    else if (extent == 0.0) extent = 0.0; /* not -0.0 */
    sight->edge[sight->edges++] = (Edge){
        right, left, (q.y - p.y) / double_area, -((q.x - p.x) / double_area), extent, box, hides};
    return true;
}

static bool add_boxes(const RoadUsers *boxes, Sight *sight) {
    for (Py_ssize_t row = 0; row < boxes->count; row++) {
        double length = lengths_of(boxes)[row], width = widths_of(boxes)[row];
        CosSin yaw = cos_sin(yaws_of(boxes)[row]);
        if (isnan(yaw.cos)) {
            PyErr_SetString(PyExc_ValueError, "expected finite yaws of boxes");
            return false;
        }
        sight->distance[row] = measure_distance(boxes, row, yaw, sight->eye);
        if (row == sight->eye.carrier_row) sight->distance[row] = INFINITY;
        if (!(sight->distance[row] <= sight->range_m)) continue;
        unsigned char kind = kinds_of(boxes)[row];
        bool hides = kind == VEHICLE || (kind == STATIC && (width > length ? width : length) > LOW_M);
        Box box = list_corners(x_of(boxes)[row], y_of(boxes)[row], yaw.cos, yaw.sin, length, width);
        for (int i = 0; i < 4; i++)
            if (!add_edge(sight, box.corner[i], box.corner[(i + 1) % 4], row, hides)) return false;
    }
    return true;
}

static bool is_building_near(const double *circle, const Sight *sight) {
    return portable_hypot(circle[0] - sight->eye.x, circle[1] - sight->eye.y) - circle[2] <= sight->range_m;
}

static bool add_walls(const double *walls, const int64_t *ends, const double *circles, Py_ssize_t buildings,
                      Sight *sight) {
    for (Py_ssize_t i = 0; i < buildings; i++) {
        if (!is_building_near(circles + 3 * i, sight)) continue;
        for (int64_t k = i ? ends[i - 1] : 0; k < ends[i]; k++) {
            const double *wall = walls + 4 * k;
            if (!add_edge(sight, (Point){wall[0], wall[1]}, (Point){wall[2], wall[3]}, -1, true)) return false;
        }
    }
    return true;
}

/* Whether every building has its walls within the array. */
static bool are_buildings_valid(const Array *walls, const Array *ends, const Array *circles) {
    bool is_valid = walls->dimensions == 2 && walls->shape[1] == 4 && ends->dimensions == 1 &&
                    circles->dimensions == 2 && circles->shape[1] == 3 && circles->shape[0] == ends->count;
    const int64_t *end = ends->data;
    for (Py_ssize_t i = 0; is_valid && i < ends->count; i++)
        is_valid = end[i] >= (i ? end[i - 1] : 0) && end[i] <= walls->shape[0];
    if (!is_valid) PyErr_SetString(PyExc_ValueError, "expected walls (W, 4), and ends (B,) and circles (B, 3) of them");
    return is_valid;
}

static bool open_buildings(PyObject *buildings, Array arrays[3]) {
    static const char types[] = {'d', 'l', 'd'};
    for (int i = 0; i < 3; i++) {
        PyObject *array = get_field(buildings, &BUILDINGS, i);
        bool is_open = array && open_array(array, types[i], arrays + i);
        if (array) Py_DecRef(array);
        if (is_open) continue;
        while (i--) close_array(arrays + i);
        return false;
    }
    return true;
}

bool open_sight(const RoadUsers *boxes, Eye eye, double range_m, PyObject *buildings, Sight *sight) {
    *sight = (Sight){eye, range_m, boxes->count, 0, NULL, NULL};
    Array arrays[3];
    if (!open_buildings(buildings, arrays)) return false;
    bool is_valid = are_buildings_valid(arrays, arrays + 1, arrays + 2);
    if (is_valid) {
        sight->distance = malloc((boxes->count + 1) * sizeof *sight->distance);
        sight->edge = malloc((4 * boxes->count + arrays[0].shape[0] + 1) * sizeof *sight->edge);
        if (!sight->distance || !sight->edge) PyErr_NoMemory(), is_valid = false;
    }
    is_valid = is_valid && add_boxes(boxes, sight) &&
               add_walls(doubles(arrays), arrays[1].data, doubles(arrays + 2), arrays[1].count, sight);
    for (int i = 0; i < 3; i++) close_array(arrays + i);
    if (!is_valid) close_sight(sight);
    return is_valid;
}

void close_sight(Sight *sight) {
    free(sight->distance);
    free(sight->edge);
}

/* An interval between two neighbouring ends of edges, and the nearest of the opaque edges within it. */
typedef struct {
    double angle, width;
    CosSin begin, end;
    double nearest_begin, nearest_end, nearest_sum, front_begin, front_end;
} Interval;

/* Intervals in which an edge lies: from `first` to `after`, counted on around the circle. */
typedef struct {
    Py_ssize_t first, after;
} Range;

static int compare_angles(const void *first, const void *second) {
    double a = *(const double *)first, b = *(const double *)second;
    return (a > b) - (a < b);
}

static Py_ssize_t bisect_left(const Interval *intervals, Py_ssize_t count, double angle) {
    Py_ssize_t low = 0, high = count;
    while (low < high) {
        Py_ssize_t middle = (low + high) / 2;
        if (intervals[middle].angle < angle) low = middle + 1;
        else high = middle;
    }
    return low;
}

static void cut_circle(const Sight *sight, double *angles, Interval *intervals, Range *ranges) {
    Py_ssize_t count = 2 * sight->edges;
    for (Py_ssize_t i = 0; i < sight->edges; i++) {
        angles[2 * i] = sight->edge[i].right;
        angles[2 * i + 1] = sight->edge[i].left;
    }
    qsort(angles, count, sizeof *angles, compare_angles);
    for (Py_ssize_t i = 0; i < count; i++)
        intervals[i] = (Interval){.angle = angles[i], .begin = cos_sin(angles[i])};
    for (Py_ssize_t i = 0; i < count; i++) {
        Py_ssize_t next = i + 1 < count ? i + 1 : 0;
        intervals[i].width = (next ? angles[next] : angles[0] + TAU) - angles[i];
        intervals[i].end = intervals[next].begin;
    }
    for (Py_ssize_t i = 0; i < sight->edges; i++) {
        Py_ssize_t first = bisect_left(intervals, count, sight->edge[i].right);
        Py_ssize_t after = bisect_left(intervals, count, sight->edge[i].left);
        ranges[i] = (Range){first, after < first ? after + count : after};
    }
}

static double invert_distance(const Edge *edge, CosSin direction) {
    return edge->cos * direction.cos + edge->sin * direction.sin;
}

static void add_opaque(Interval *interval, const Edge *edge) {
    double begin = invert_distance(edge, interval->begin), end = invert_distance(edge, interval->end);
    if (begin + end >= interval->nearest_sum) interval->front_begin = begin, interval->front_end = end;
    if (begin > interval->nearest_begin) interval->nearest_begin = begin;
    if (end > interval->nearest_end) interval->nearest_end = end;
    if (begin + end > interval->nearest_sum) interval->nearest_sum = begin + end;
}

static bool lies_in(Range range, Py_ssize_t interval, Py_ssize_t count) {
    return (range.first <= interval && interval < range.after) || interval + count < range.after;
}

/* The visible width of edge i within an interval where boxes overlap; NaN if it has none. */
static double measure_between(const Sight *sight, const Range *ranges, Py_ssize_t i, const Interval *intervals,
                              Py_ssize_t place) {
    const Interval *interval = intervals + place;
    double since = 0.0, until = interval->width;
    CosSin last = cos_sin(interval->angle + interval->width);
    for (Py_ssize_t k = 0; k < sight->edges; k++) {
        if (k == i || !sight->edge[k].hides || !lies_in(ranges[k], place, 2 * sight->edges)) continue;
        double a = sight->edge[k].cos - sight->edge[i].cos, b = sight->edge[k].sin - sight->edge[i].sin;
        bool hides_first = a * interval->begin.cos + b * interval->begin.sin > 0.0;
        bool hides_last = a * last.cos + b * last.sin > 0.0;
        double towards = portable_atan2(-a, b), change = fmod(towards - interval->angle, PI);
        if (isnan(towards)) return NAN;
        if (change < 0.0) change += PI;
        if (interval->width < change) change = interval->width;
        if (hides_first) {
            double hidden = hides_last ? interval->width : change;
            if (hidden > since) since = hidden;
        } else if (hides_last && change < until) {
            until = change;
        }
    }
    return until - since > 0.0 ? until - since : 0.0;
}

static double measure_visible(const Sight *sight, const Range *ranges, Py_ssize_t i, const Interval *intervals,
                              Py_ssize_t place) {
    const Edge *edge = sight->edge + i;
    const Interval *interval = intervals + place;
    double begin = invert_distance(edge, interval->begin), end = invert_distance(edge, interval->end);
    if (begin >= interval->nearest_begin - TIE && end >= interval->nearest_end - TIE) return interval->width;
    bool is_front = edge->hides && begin + end >= interval->nearest_sum;
    if (interval->front_begin >= begin - TIE && interval->front_end >= end - TIE && !is_front) return 0.0;
    return measure_between(sight, ranges, i, intervals, place);
}

/* extents and fractions: (boxes,) of zeros; the visible widths are left in fractions. */
static bool add_widths(const Sight *sight, Interval *intervals, const Range *ranges, double *extents, double *widths) {
    Py_ssize_t count = 2 * sight->edges;
    for (Py_ssize_t i = 0; i < sight->edges; i++) {
        if (!sight->edge[i].hides) continue;
        for (Py_ssize_t k = ranges[i].first; k < ranges[i].after; k++)
            add_opaque(intervals + (k < count ? k : k - count), sight->edge + i);
    }
    for (Py_ssize_t i = 0; i < sight->edges && sight->edge[i].box >= 0; i++) {
        double width = 0.0;
        for (Py_ssize_t k = ranges[i].first; k < ranges[i].after; k++)
            width += measure_visible(sight, ranges, i, intervals, k < count ? k : k - count);
        if (isnan(width)) {
            PyErr_SetString(PyExc_ValueError, "expected finite corners of boxes and buildings");
            return false;
        }
        extents[sight->edge[i].box] += sight->edge[i].extent;
        widths[sight->edge[i].box] += width;
    }
    return true;
}

bool fill_visible_fractions(const Sight *sight, double *fractions) {
    Py_ssize_t count = 2 * sight->edges;
    size_t numbers = sight->boxes + count + 1;
    double *extents = calloc(numbers, sizeof *extents), *angles = extents ? extents + sight->boxes : NULL;
    Interval *intervals = malloc((count + 1) * sizeof *intervals);
    Range *ranges = malloc((sight->edges + 1) * sizeof *ranges);
    bool is_valid = extents && intervals && ranges;
    if (!is_valid) PyErr_NoMemory();
    memset(fractions, 0, sight->boxes * sizeof *fractions);
    if (is_valid) {
        cut_circle(sight, angles, intervals, ranges);
        is_valid = add_widths(sight, intervals, ranges, extents, fractions);
    }
    for (Py_ssize_t row = 0; is_valid && row < sight->boxes; row++) {
        if (!(sight->distance[row] <= sight->range_m)) continue;
        double share = extents[row] > 0.0 ? fractions[row] / extents[row] : 1.0;
        fractions[row] = 0.0 > share ? 0.0 : 1.0 < share ? 1.0 : share;
    }
    free(extents);
    free(intervals);
    free(ranges);
    return is_valid;
}

/* As Python's x % TAU. */
static double wrap_to_turn(double x) {
    double rest = fmod(x, TAU);
    return rest < 0.0 ? rest + TAU : rest == 0.0 ? 0.0 : rest;
}

bool fill_free_sight(const Sight *sight, Py_ssize_t sectors, double *free_m) {
    CosSin yaw = cos_sin(sight->eye.yaw);
    if (isnan(yaw.cos) || sectors < 1 || sight->range_m == 0.0) {
        PyErr_SetString(PyExc_ValueError, "expected a finite yaw, at least one sector, and a range above 0");
        return false;
    }
    double step = TAU / (double)sectors;
    CosSin *rays = malloc(sectors * sizeof *rays);
    if (!rays) return PyErr_NoMemory(), false;
    for (Py_ssize_t i = 0; i < sectors; i++) {
        CosSin ray = cos_sin((double)i * step);
        rays[i] = (CosSin){ray.cos * yaw.cos - ray.sin * yaw.sin, ray.sin * yaw.cos + ray.cos * yaw.sin};
        free_m[i] = 1.0 / sight->range_m;
    }
    for (Py_ssize_t i = 0; i < sight->edges; i++) {
        const Edge *edge = sight->edge + i;
        if (!edge->hides) continue;
        double turned = wrap_to_turn(edge->right - sight->eye.yaw) / step;
        Py_ssize_t last = (Py_ssize_t)floor(turned + edge->extent / step);
        for (Py_ssize_t count = (Py_ssize_t)ceil(turned); count <= last; count++) {
            double inverse_m = invert_distance(edge, rays[count % sectors]);
            if (inverse_m > free_m[count % sectors]) free_m[count % sectors] = inverse_m;
        }
    }
    free(rays);
    for (Py_ssize_t i = 0; i < sectors; i++) {
        if (free_m[i] == 0.0) {
            PyErr_SetString(PyExc_ZeroDivisionError, "expected a finite range");
            return false;
        }
        free_m[i] = 1.0 / free_m[i];
    }
    return true;
}

/* Arguments that all functions begin with: boxes, eye, range, buildings. */
static bool open_arguments(PyObject *const *arguments, RoadUsers *boxes, Sight *sight) {
    Eye eye;
    double range_m;
    if (!read_eye(arguments[1], &eye) || !read_number(arguments[2], &range_m) || !open_road_users(arguments[0], boxes))
        return false;
    if (open_sight(boxes, eye, range_m, arguments[3], sight)) return true;
    close_road_users(boxes);
    return false;
}

static PyObject *sensing_visibility_measure_distances(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Eye eye;
    RoadUsers boxes;
    if (!expect_arguments("measure_distances", count, 2, 2) || !read_eye(arguments[1], &eye) ||
        !open_road_users(arguments[0], &boxes))
        return NULL;
    double *distances;
    PyObject *result = new_doubles(1, &boxes.count, &distances);
    for (Py_ssize_t row = 0; result && row < boxes.count; row++) {
        CosSin yaw = cos_sin(yaws_of(&boxes)[row]);
        distances[row] = row == eye.carrier_row ? INFINITY : measure_distance(&boxes, row, yaw, eye);
        if (isnan(yaw.cos)) {
            PyErr_SetString(PyExc_ValueError, "expected finite yaws of boxes");
            Py_DecRef(result);
            result = NULL;
        }
    }
    close_road_users(&boxes);
    return result;
}

static PyObject *sensing_visibility_compute_visible_fractions(PyObject *module, PyObject *const *arguments,
                                                              Py_ssize_t count) {
    RoadUsers boxes;
    Sight sight;
    if (!expect_arguments("compute_visible_fractions", count, 4, 4) || !open_arguments(arguments, &boxes, &sight))
        return NULL;
    double *fractions;
    PyObject *result = new_doubles(1, &boxes.count, &fractions);
    if (result && !fill_visible_fractions(&sight, fractions)) {
        Py_DecRef(result);
        result = NULL;
    }
    close_sight(&sight);
    close_road_users(&boxes);
    return result;
}

static PyObject *sensing_visibility_measure_free_sight(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    RoadUsers boxes;
    Sight sight;
    Py_ssize_t sectors;
    if (!expect_arguments("measure_free_sight", count, 5, 5) || !read_integer(arguments[4], &sectors)) return NULL;
    if (sectors < 0) sectors = 0;
    if (!open_arguments(arguments, &boxes, &sight)) return NULL;
    double *free_m;
    PyObject *result = new_doubles(1, &sectors, &free_m);
    if (result && !fill_free_sight(&sight, sectors, free_m)) {
        Py_DecRef(result);
        result = NULL;
    }
    close_sight(&sight);
    close_road_users(&boxes);
    return result;
}

Functions sensing_visibility = {
    FUNCTION(sensing_visibility_measure_distances),
    FUNCTION(sensing_visibility_compute_visible_fractions),
    FUNCTION(sensing_visibility_measure_free_sight),
    END_OF_FUNCTIONS,
};
