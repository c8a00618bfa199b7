/* Twins of reference_path.py. */
#include "reference_path.h"

#include "../core/compiled/values.h"
#include "../core/portable.h"

/* The largest index is count - 1; NaN and infinity have none. */
static bool find_index(double place, Py_ssize_t least, Py_ssize_t most, Py_ssize_t *index) {
    if (!isfinite(place)) return refuse_numbers("project_on_points");
    *index = place < (double)least ? least : place > (double)most ? most : (Py_ssize_t)place;
    return true;
}

/* As numpy.interp at the whole numbers 0 to count - 1, column 0 or 1. */
static double interpolate(const double *xy, Py_ssize_t count, double index, int column) {
    const double *values = xy + column;
    if (count == 1 || index < 0.0) return values[0];
    if (isnan(index)) return index;
    if (index >= (double)(count - 1)) return values[2 * (count - 1)];
    Py_ssize_t before = (Py_ssize_t)index;
    double low = values[2 * before], high = values[2 * before + 2], share = index - (double)before;
    if (share == 0.0) return low;
    double value = (high - low) * share + low;
    if (isnan(value)) value = (high - low) * (share - 1.0) + high;
    return isnan(value) && low == high ? low : value;
}

static PyObject *planning_reference_path_interpolate_points(PyObject *module, PyObject *const *arguments,
                                                            Py_ssize_t count) {
    if (!expect_arguments("interpolate_points", count, 2, 2)) return NULL;
    Array xy, stations;
    if (!open_doubles(arguments[0], 2, &xy)) return NULL;
    if (!open_doubles(arguments[1], 1, &stations)) {
        close_array(&xy);
        return NULL;
    }
    PyObject *result = NULL;
    double *points;
    if (xy.shape[0] < 1 || xy.shape[1] != 2) PyErr_SetString(PyExc_ValueError, "expected points (M, 2), M >= 1");
    else result = new_doubles(2, (Py_ssize_t[]){stations.count, 2}, &points);
    for (Py_ssize_t i = 0; result && i < stations.count; i++)
        for (int column = 0; column < 2; column++)
            points[2 * i + column] = interpolate(doubles(&xy), xy.shape[0], doubles(&stations)[i] / SPACING_M, column);
    close_array(&xy);
    close_array(&stations);
    return result;
}

/* The first row of the least distance, or of one that is not a number, as numpy.argmin. */
static Py_ssize_t find_nearest(const double *xy, Py_ssize_t low, Py_ssize_t high, double x, double y) {
    Py_ssize_t nearest = low;
    double least = INFINITY;
    for (Py_ssize_t i = low; i < high; i++) {
        double dx = x - xy[2 * i], dy = y - xy[2 * i + 1], square = dx * dx + dy * dy;
        if (isnan(square)) return i;
        if (square < least) nearest = i, least = square;
    }
    return nearest;
}

static PyObject *planning_reference_path_project_on_points(PyObject *module, PyObject *const *arguments,
                                                           Py_ssize_t count) {
    if (!expect_arguments("project_on_points", count, 6, 6)) return NULL;
    double place[4];
    Array xy, yaw;
    if (!read_numbers(arguments + 2, 4, place) || !open_doubles(arguments[0], 2, &xy)) return NULL;
    if (!open_doubles(arguments[1], 1, &yaw)) {
        close_array(&xy);
        return NULL;
    }
    PyObject *result = NULL;
    double x = place[0], y = place[1], near_s = place[2], within_m = place[3];
    Py_ssize_t rows = yaw.count, low, high;
    if (rows < 1 || xy.shape[0] != rows || xy.shape[1] != 2)
        PyErr_SetString(PyExc_ValueError, "expected points (M, 2) and directions (M,), M >= 1");
    else if (find_index((near_s + within_m) / SPACING_M, -1, rows, &high) &&
             find_index((near_s - within_m) / SPACING_M, 0, rows, &low)) {
        high = high + 2 < rows ? high + 2 : rows;
        if (low > high - 1) low = high - 1;
        Py_ssize_t i = find_nearest(doubles(&xy), low, high, x, y);
        CosSin direction = cos_sin(doubles(&yaw)[i]);
        double dx = x - doubles(&xy)[2 * i], dy = y - doubles(&xy)[2 * i + 1];
        double s = (double)i * SPACING_M + (direction.cos * dx + direction.sin * dy), length = (double)(rows - 1) * SPACING_M;
        if (0.0 > s) s = 0.0;
        if (length < s) s = length;
        result = isfinite(direction.cos) ? PyFloat_FromDouble(s) : refuse_numbers("project_on_points");
    }
    close_array(&xy);
    close_array(&yaw);
    return result;
}

static PyObject *planning_reference_path_integrate_body_yaw(PyObject *module, PyObject *const *arguments,
                                                            Py_ssize_t count) {
    if (!expect_arguments("integrate_body_yaw", count, 3, 3)) return NULL;
    double rear_to_centre, first;
    Array yaw;
    if (!read_number(arguments[1], &rear_to_centre) || !read_number(arguments[2], &first) ||
        !open_doubles(arguments[0], 1, &yaw))
        return NULL;
    double *body;
    Py_ssize_t rows = yaw.count ? yaw.count : 1;
    PyObject *result = new_doubles(1, &rows, &body);
    for (Py_ssize_t i = 0; result && i < rows; i++) {
        double sine = i ? cos_sin(doubles(&yaw)[i - 1] - body[i - 1]).sin : 0.0;
        body[i] = i ? body[i - 1] + SPACING_M * sine / rear_to_centre : first;
        if (!isfinite(sine) || (i && rear_to_centre == 0.0)) {
            Py_DecRef(result);
            result = refuse_numbers("integrate_body_yaw");
        }
    }
    close_array(&yaw);
    return result;
}

static PyObject *planning_reference_path_limit_to_braking(PyObject *module, PyObject *const *arguments,
                                                          Py_ssize_t count) {
    if (!expect_arguments("limit_to_braking", count, 2, 2)) return NULL;
    double braking;
    Array speeds;
    if (!read_number(arguments[1], &braking) || !open_doubles(arguments[0], 1, &speeds)) return NULL;
    double *limited;
    PyObject *result = new_doubles(1, speeds.shape, &limited);
    for (Py_ssize_t i = speeds.count - 1; result && i >= 0; i--) {
        limited[i] = doubles(&speeds)[i];
        if (i == speeds.count - 1) continue;
        double square = limited[i + 1] * limited[i + 1] + 2 * braking * SPACING_M;
        if (square < 0.0) {
            Py_DecRef(result);
            result = refuse_numbers("limit_to_braking");
            break;
        }
        double reached = sqrt(square);
        if (reached < limited[i]) limited[i] = reached;
    }
    close_array(&speeds);
    return result;
}

static PyObject *planning_reference_path_find_slowest(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("find_slowest", count, 3, 3)) return NULL;
    Py_ssize_t first, most;
    Array limits;
    if (!read_integer(arguments[1], &first) || !read_integer(arguments[2], &most) ||
        !open_doubles(arguments[0], 1, &limits))
        return NULL;
    Py_ssize_t slowest = first, end = most < limits.count - first ? first + most : limits.count;
    if (first < 0 || first >= end) PyErr_SetString(PyExc_ValueError, "expected one limit at least");
    else
        for (Py_ssize_t i = first; i < end && !isnan(doubles(&limits)[slowest]); i++)
            if (!(doubles(&limits)[i] >= doubles(&limits)[slowest])) slowest = i; /* a NaN is the lowest, as in NumPy */
    close_array(&limits);
    return PyErr_Occurred() ? NULL : PyLong_FromSsize_t(slowest);
}

Functions planning_reference_path = {
    FUNCTION(planning_reference_path_interpolate_points),
    FUNCTION(planning_reference_path_project_on_points),
    FUNCTION(planning_reference_path_integrate_body_yaw),
    FUNCTION(planning_reference_path_limit_to_braking),
    FUNCTION(planning_reference_path_find_slowest),
    END_OF_FUNCTIONS,
};
