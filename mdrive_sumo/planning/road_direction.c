/* Twins of road_direction.py. */
#include "road_direction.h"

#include "../core/state.h"

FIELDS(ROAD, "s", "yaw", "xy");
static Import ROAD_POSITION = {"mdrive_sumo.planning.road_direction", "RoadPosition", 0};
enum { COARSE = 4 }; /* every so many points of the path are compared */

bool open_road(PyObject *road, Road *opened) {
    Array *arrays[] = {&opened->s, &opened->yaw, &opened->xy};
    for (int i = 0; i < 3; i++)
        if (!open_field(road, &ROAD, i, 'd', i < 2 ? 1 : 2, arrays[i])) {
            close_arrays(i, arrays);
            return false;
        }
    Py_ssize_t count = opened->s.count;
    if (count && opened->yaw.count == count && opened->xy.shape[0] == count && opened->xy.shape[1] == 2) return true;
    close_arrays(3, arrays);
    PyErr_SetString(PyExc_ValueError, "expected a road of at least one point");
    return false;
}

void close_road(Road *road) { close_arrays(3, (Array *[]){&road->s, &road->yaw, &road->xy}); }

double get_road_yaw(const Road *road, double s) {
    return interpolate(s, doubles(&road->s), doubles(&road->yaw), 1, road->s.count);
}

bool find_road_point(const Road *road, double s, Point *point) {
    const double *stations = doubles(&road->s), *xy = doubles(&road->xy);
    double first = stations[0], last = stations[road->s.count - 1], over = s - (s < first ? first : s > last ? last : s);
    CosSin direction = cos_sin(get_road_yaw(road, s));
    point->x = interpolate(s, stations, xy, 2, road->s.count) + over * direction.cos;
    point->y = interpolate(s, stations, xy + 1, 2, road->s.count) + over * direction.sin;
    if (isfinite(direction.cos)) return true;
    PyErr_SetString(PyExc_ValueError, "expected finite stations, found NaN");
    return false;
}

static PyObject *planning_road_direction_find_points(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Road road;
    Array s;
    if (!expect_arguments("find_points", count, 2, 2) || !open_doubles(arguments[1], 1, &s)) return NULL;
    if (!open_road(arguments[0], &road)) {
        close_array(&s);
        return NULL;
    }
    double *points;
    PyObject *result = new_doubles(2, (Py_ssize_t[]){s.count, 2}, &points);
    for (Py_ssize_t i = 0; result && i < s.count; i++)
        if (!find_road_point(&road, doubles(&s)[i], (Point *)points + i)) Py_DecRef(result), result = NULL;
    close_array(&s);
    close_road(&road);
    return result;
}

static Py_ssize_t find_nearest(const Path *path, double x, double y) {
    const double *xy = doubles(&path->xy);
    double least_square = INFINITY;
    Py_ssize_t nearest = 0;
    for (Py_ssize_t i = 0; i < path->count; i += COARSE) {
        double dx = x - xy[2 * i], dy = y - xy[2 * i + 1], square = dx * dx + dy * dy;
        if (square < least_square) least_square = square, nearest = i;
    }
    return nearest;
}

static PyObject *locate(const Road *road, const Path *path, const RoadUsers *users) {
    double *station, *lateral, *turned;
    PyObject *class = find_import(&ROAD_POSITION), *result = NULL;
    PyObject *values[] = {new_doubles(1, &users->count, &station), new_doubles(1, &users->count, &lateral),
                          new_doubles(1, &users->count, &turned)};
    bool are_made = class && values[0] && values[1] && values[2];
    for (Py_ssize_t row = 0; are_made && row < users->count; row++) {
        double x = x_of(users)[row], y = y_of(users)[row];
        Py_ssize_t i = find_nearest(path, x, y);
        CosSin direction = cos_sin(doubles(&path->yaw)[i]);
        double dx = x - doubles(&path->xy)[2 * i], dy = y - doubles(&path->xy)[2 * i + 1];
        station[row] = (double)i * SPACING_M + dx * direction.cos + dy * direction.sin;
        lateral[row] = dy * direction.cos - dx * direction.sin;
        turned[row] = wrap_half_open(yaws_of(users)[row] - get_road_yaw(road, station[row]));
    }
    if (are_made) result = PyObject_CallFunctionObjArgs(class, values[0], values[1], values[2], NULL);
    for (int i = 0; i < 3; i++)
        if (values[i]) Py_DecRef(values[i]);
    return result;
}

static PyObject *planning_road_direction_locate_objects(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Road road;
    Path path;
    RoadUsers users;
    if (!expect_arguments("locate_objects", count, 3, 3) || !open_road(arguments[0], &road)) return NULL;
    PyObject *result = NULL;
    if (open_path(arguments[1], &path)) {
        if (open_road_users(arguments[2], &users)) {
            result = locate(&road, &path, &users);
            close_road_users(&users);
        }
        close_path(&path);
    }
    close_road(&road);
    return result;
}

Functions planning_road_direction = {
    FUNCTION(planning_road_direction_find_points),
    FUNCTION(planning_road_direction_locate_objects),
    END_OF_FUNCTIONS,
};
