/* Twins of fleet_paths.py. */
#include <stdlib.h>
#include <string.h>

#include "../core/state.h"
#include "path_overlap.h"

FIELDS(JOINT, "standing_speed", "pedestrian_prediction_s", "vehicle_prediction_s", "growth");
enum { STANDING_SPEED, PEDESTRIAN_S, VEHICLE_S, GROWTH };
FIELDS(MARGIN, "longitudinal", "lateral");
FIELDS(MARGINS_FIELDS, "standing");
static Import JOINT_PLANNING = {"mdrive_sumo.planning.parameters", "JOINT_PLANNING", 0};
static Import MARGINS = {"mdrive_sumo.planning.parameters", "MARGINS", 0};

static double measure_square(Point a, Point b) {
    double dx = a.x - b.x, dy = a.y - b.y;
    return dx * dx + dy * dy;
}

/* The nearest of every `step`-th of the points from `low` up to before `high`. */
static Py_ssize_t find_nearest(const Point *path, Py_ssize_t low, Py_ssize_t high, Py_ssize_t step, Point point) {
    double least_square = INFINITY;
    Py_ssize_t nearest = low;
    for (Py_ssize_t i = low; i < high; i += step) {
        double square = measure_square(point, path[i]);
        if (square < least_square) least_square = square, nearest = i;
    }
    return nearest;
}

/* Stations (P,) of points on a path; on every `coarse`-th point first. */
static PyObject *locate(const Array *path, const Array *points, Py_ssize_t coarse) {
    double *stations, furthest = 0.0;
    PyObject *result = new_doubles(1, points->shape, &stations);
    Py_ssize_t count = path->shape[0];
    for (Py_ssize_t i = 0; result && i < points->shape[0]; i++) {
        Point point = ((const Point *)points->data)[i];
        Py_ssize_t cell = find_nearest(path->data, 0, count, coarse, point);
        if (coarse > 1) {
            Py_ssize_t low = cell > coarse ? cell - coarse : 0, high = cell + coarse + 1;
            cell = find_nearest(path->data, low, high < count ? high : count, 1, point);
        }
        if ((double)cell * SPACING_M > furthest) furthest = (double)cell * SPACING_M;
        stations[i] = furthest;
    }
    return result;
}

static PyObject *planning_fleet_paths_locate_points(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Py_ssize_t coarse;
    Array path, points;
    if (!expect_arguments("locate_points", count, 3, 3) || !read_integer(arguments[2], &coarse) ||
        !open_doubles(arguments[0], 2, &path))
        return NULL;
    if (!open_doubles(arguments[1], 2, &points)) {
        close_array(&path);
        return NULL;
    }
    PyObject *result = NULL;
    if (coarse > 0 && path.shape[0] && path.shape[1] == 2 && points.shape[1] == 2) result = locate(&path, &points, coarse);
    else PyErr_SetString(PyExc_ValueError, "expected points (P, 2), and a path (M, 2), M >= 1");
    close_arrays(2, (Array *[]){&path, &points});
    return result;
}

/* A table of overlaps of two paths, and which rows of it belong to cells. */
typedef struct {
    const bool *table;
    Py_ssize_t own_rows, other_rows, own_step, other_step, stride;
} Overlaps;

static Py_ssize_t find_row(const Overlaps *overlaps, Py_ssize_t cell, Py_ssize_t rows) {
    Py_ssize_t shifted = cell + overlaps->stride / 2, row = shifted / overlaps->stride;
    if (shifted % overlaps->stride < 0) row--;
    if (row < 0) row += rows; /* as NumPy: a car may begin a little before its path */
    return row < 0 ? 0 : row < rows ? row : rows - 1;
}

static PyObject *look_up(const Overlaps *overlaps, const Array *cells, const Array *stations, Py_ssize_t other_points,
                         double end_s) {
    void *data = NULL;
    Py_ssize_t *places = malloc((size_t)(cells->count + 1) * sizeof *places); /* of the own cells in the table */
    PyObject *result = places ? new_array('?', 2, (Py_ssize_t[]){stations->count, cells->count}, &data) : PyErr_NoMemory();
    for (Py_ssize_t k = 0; result && k < cells->count; k++)
        places[k] = find_row(overlaps, (Py_ssize_t)integers(cells)[k], overlaps->own_rows) * overlaps->own_step;
    bool *mask = data;
    for (Py_ssize_t i = 0; result && i < stations->count; i++, mask += cells->count) {
        double s = doubles(stations)[i], cell = round_even(s / SPACING_M);
        Py_ssize_t last = other_points - 1, place = cell > 0.0 ? cell < (double)last ? (Py_ssize_t)cell : last : 0;
        const bool *column = overlaps->table + find_row(overlaps, place, overlaps->other_rows) * overlaps->other_step;
        for (Py_ssize_t k = 0; k < cells->count; k++) mask[k] = s < end_s && column[places[k]];
    }
    free(places);
    return result;
}

static PyObject *planning_fleet_paths_look_up_overlaps(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Py_ssize_t other_points;
    double end_s;
    Overlaps overlaps;
    Array table, cells, stations;
    if (!expect_arguments("look_up_overlaps", count, 7, 7)) return NULL;
    int is_transposed = PyObject_IsTrue(arguments[1]);
    if (is_transposed < 0 || !read_integer(arguments[4], &overlaps.stride) || !read_integer(arguments[5], &other_points) ||
        !read_number(arguments[6], &end_s) || !open_array(arguments[0], '?', &table))
        return NULL;
    if (!open_array(arguments[2], 'l', &cells)) {
        close_array(&table);
        return NULL;
    }
    if (!open_doubles(arguments[3], 1, &stations)) {
        close_arrays(2, (Array *[]){&table, &cells});
        return NULL;
    }
    PyObject *result = NULL;
    if (table.dimensions == 2 && table.count && overlaps.stride > 0 && other_points > 0) {
        overlaps.table = table.data;
        overlaps.own_rows = table.shape[is_transposed], overlaps.other_rows = table.shape[!is_transposed];
        overlaps.own_step = is_transposed ? 1 : table.shape[1], overlaps.other_step = is_transposed ? table.shape[1] : 1;
        result = look_up(&overlaps, &cells, &stations, other_points, end_s);
    } else {
        PyErr_SetString(PyExc_ValueError, "expected a table of overlaps (A, B), a stride and a path of 1 or more points");
    }
    close_arrays(3, (Array *[]){&table, &cells, &stations});
    return result;
}

/* What blocks the cells of a path: the own footprints and a mask (times, cells). */
typedef struct {
    Path path;
    Array cells, times;
    RoadUsers users;
    double joint[4], size[2], margin[2];
    Box *own;
    Py_ssize_t *rows;
    bool *mask;
} Blocking;

static bool measure_own(Blocking *now, const double *margin, BoxSet *set) {
    double length = now->size[0] + 2 * margin[0], width = now->size[1] + 2 * margin[1];
    return place_footprints(&now->path, integers(&now->cells), now->cells.count, length, width, now->own) &&
           measure_boxes(set, now->own, now->cells.count);
}

/* Mark in a row of the mask where an object is after t seconds, enlarged by its uncertainty. */
static bool mark_object(Blocking *now, const BoxSet *set, Py_ssize_t object, double t, bool *mask) {
    const RoadUsers *users = &now->users;
    double ahead_m = speeds_of(users)[object] * t, yaw = yaws_of(users)[object], growth = 2 * now->joint[GROWTH] * t;
    CosSin direction = cos_sin(yaw);
    Box box;
    if (!place_box(x_of(users)[object] + ahead_m * direction.cos, y_of(users)[object] + ahead_m * direction.sin, yaw,
                   lengths_of(users)[object] + growth, widths_of(users)[object] + growth, &box))
        return false;
    Circle circle = measure_box(&box);
    Py_ssize_t found = find_overlapping(set, &box, &circle, now->rows);
    for (Py_ssize_t i = 0; i < found; i++) mask[now->rows[i]] = true;
    return true;
}

static bool stands(const Blocking *now, Py_ssize_t object) {
    return fabs(speeds_of(&now->users)[object]) < now->joint[STANDING_SPEED];
}

static bool mark_standing(Blocking *now, const double *margin) {
    BoxSet set = {0};
    bool is_marked = measure_own(now, margin, &set);
    for (Py_ssize_t object = 0; is_marked && object < now->users.count; object++)
        if (stands(now, object)) is_marked = mark_object(now, &set, object, 0.0, now->mask);
    for (Py_ssize_t row = 1; is_marked && row < now->times.count; row++)
        memcpy(now->mask + row * now->cells.count, now->mask, (size_t)now->cells.count);
    release_boxes(&set);
    return is_marked;
}

static bool mark_moving(Blocking *now) {
    BoxSet set = {0};
    bool is_marked = measure_own(now, now->margin, &set);
    for (Py_ssize_t object = 0; is_marked && object < now->users.count; object++) {
        if (stands(now, object)) continue;
        double horizon_s = now->joint[kinds_of(&now->users)[object] == PEDESTRIAN ? PEDESTRIAN_S : VEHICLE_S];
        for (Py_ssize_t row = 0; is_marked && row < now->times.count; row++) {
            double t = doubles(&now->times)[row];
            if (t <= horizon_s) is_marked = mark_object(now, &set, object, t, now->mask + row * now->cells.count);
        }
    }
    release_boxes(&set);
    return is_marked;
}

static bool read_pair(PyObject *pair, double *numbers) {
    PyObject *first = PySequence_GetItem(pair, 0), *second = first ? PySequence_GetItem(pair, 1) : NULL;
    bool is_read = second && read_number(first, numbers) && read_number(second, numbers + 1);
    if (first) Py_DecRef(first);
    if (second) Py_DecRef(second);
    return is_read;
}

/* The margin to standing road users: at most that of the parameters. */
static bool limit_margin(const double *margin, double *standing) {
    PyObject *margins = find_import(&MARGINS), *most = margins ? get_field(margins, &MARGINS_FIELDS, 0) : NULL;
    bool is_read = most && read_fields(most, &MARGIN, standing);
    if (most) Py_DecRef(most);
    for (int i = 0; is_read && i < 2; i++) standing[i] = standing[i] < margin[i] ? standing[i] : margin[i];
    return is_read;
}

static PyObject *mark_blocked(Blocking *now) {
    Py_ssize_t shape[] = {now->times.count, now->cells.count};
    double standing[2];
    void *data;
    PyObject *result = limit_margin(now->margin, standing) ? new_array('?', 2, shape, &data) : NULL;
    if (!result) return NULL;
    now->mask = data;
    memset(now->mask, 0, (size_t)(shape[0] * shape[1]));
    if (!now->users.count || !shape[0] || (mark_standing(now, standing) && mark_moving(now))) return result;
    Py_DecRef(result);
    return NULL;
}

static bool open_blocking(PyObject *const *arguments, Blocking *now) {
    PyObject *joint = find_import(&JOINT_PLANNING);
    if (!joint || !read_fields(joint, &JOINT, now->joint) || !read_pair(arguments[4], now->size) ||
        !read_fields(arguments[5], &MARGIN, now->margin) || !open_path(arguments[0], &now->path))
        return false;
    if (!open_array(arguments[1], 'l', &now->cells)) {
        close_path(&now->path);
        return false;
    }
    if (!open_doubles(arguments[3], 1, &now->times)) {
        close_path(&now->path);
        close_array(&now->cells);
        return false;
    }
    if (open_road_users(arguments[2], &now->users)) return true;
    close_path(&now->path);
    close_arrays(2, (Array *[]){&now->cells, &now->times});
    return false;
}

static PyObject *planning_fleet_paths_find_cells_blocked_by_objects(PyObject *module, PyObject *const *arguments,
                                                                    Py_ssize_t count) {
    Blocking now = {0};
    if (!expect_arguments("find_cells_blocked_by_objects", count, 6, 6) || !open_blocking(arguments, &now)) return NULL;
    now.own = malloc((size_t)(now.cells.count + 1) * sizeof *now.own);
    now.rows = malloc((size_t)(now.cells.count + 1) * sizeof *now.rows);
    PyObject *result = now.own && now.rows ? mark_blocked(&now) : PyErr_NoMemory();
    free(now.own), free(now.rows);
    close_path(&now.path);
    close_arrays(2, (Array *[]){&now.cells, &now.times});
    close_road_users(&now.users);
    return result;
}

Functions planning_fleet_paths = {
    FUNCTION(planning_fleet_paths_locate_points),
    FUNCTION(planning_fleet_paths_look_up_overlaps),
    FUNCTION(planning_fleet_paths_find_cells_blocked_by_objects),
    END_OF_FUNCTIONS,
};
