/* Twins of path_follower.py. */
#include "../core/compiled/values.h"
#include "../core/portable.h"
#include "reference_path.h"

static PyObject *planning_path_follower_integrate(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("integrate", count, 6, 6)) return NULL;
    double values[4];
    Py_ssize_t steps;
    Array limits;
    if (!read_numbers(arguments + 1, 4, values) || !read_integer(arguments[5], &steps) ||
        !open_doubles(arguments[0], 1, &limits))
        return NULL;
    double s = values[0], speed = values[1], acceleration = values[2], dt = values[3], *stations;
    PyObject *result = NULL;
    if (steps < 0 || limits.count < 1) PyErr_SetString(PyExc_ValueError, "expected limits, and steps >= 0");
    else result = new_doubles(1, &steps, &stations);
    for (Py_ssize_t i = 0; result && i < steps; i++) {
        double place = s / SPACING_M, last = (double)(limits.count - 1);
        if (!isfinite(place)) {
            Py_DecRef(result);
            result = refuse_numbers("integrate");
            break;
        }
        double limit = doubles(&limits)[(Py_ssize_t)(place < 0.0 ? 0.0 : place < last ? place : last)];
        double after = speed + acceleration * dt;
        if (0.0 > after) after = 0.0;
        if (limit < after) after = limit;
        stations[i] = s = s + (speed + after) / 2 * dt;
        speed = after;
    }
    close_array(&limits);
    return result ? pack(2, result, PyFloat_FromDouble(speed)) : NULL;
}

Functions planning_path_follower = {FUNCTION(planning_path_follower_integrate), END_OF_FUNCTIONS};
