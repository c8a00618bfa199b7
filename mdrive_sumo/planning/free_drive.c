/* Twin of free_drive.py. */
#include "path_overlap.h"

enum { S, SPEED, ACCELERATION, BRAKING, STEP_S, NUMBERS };

static PyObject *planning_free_drive_drive_freely(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double numbers[NUMBERS], *stations;
    Py_ssize_t steps;
    Array limits;
    if (!expect_arguments("drive_freely", count, 7, 7) || !read_numbers(arguments + 1, NUMBERS, numbers) ||
        !read_integer(arguments[6], &steps) || !open_doubles(arguments[0], 1, &limits))
        return NULL;
    PyObject *result = NULL;
    if (!limits.count || steps < 0) PyErr_SetString(PyExc_ValueError, "expected limits of speed, and a number of steps");
    else result = new_doubles(1, &steps, &stations);
    double s = numbers[S], speed = numbers[SPEED], step_s = numbers[STEP_S];
    for (Py_ssize_t i = 0; result && i < steps; i++) {
        double cell = s / SPACING_M, last = (double)(limits.count - 1);
        if (!isfinite(cell)) {
            Py_DecRef(result);
            result = refuse_numbers("drive_freely");
            break;
        }
        double limit = doubles(&limits)[cell > 0.0 ? cell < last ? (Py_ssize_t)cell : limits.count - 1 : 0];
        double slowest = speed - numbers[BRAKING] * step_s, after = speed + numbers[ACCELERATION] * step_s;
        if (slowest > limit) limit = slowest;
        if (limit < after) after = limit;
        s += (speed + after) / 2 * step_s;
        speed = after;
        stations[i] = s;
    }
    close_array(&limits);
    return result;
}

Functions planning_free_drive = {
    FUNCTION(planning_free_drive_drive_freely),
    END_OF_FUNCTIONS,
};
