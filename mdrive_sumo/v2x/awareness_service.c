/* Twins of awareness_service.py: which detections a CPM has, and the errors that it states. */
#include <math.h>
#include <string.h>

#include "../contract/detector_profiles.h"
#include "../core/portable.h"

FIELDS(POSE, "x", "y");

/* Opens x and y (N,). */
static bool open_places(PyObject *const *objects, Array *x, Array *y) {
    if (!open_doubles(objects[0], 1, x)) return false;
    if (!open_doubles(objects[1], 1, y)) {
        close_array(x);
        return false;
    }
    if (x->count == y->count) return true;
    close_arrays(2, (Array *[]){x, y});
    PyErr_Format(PyExc_ValueError, "expected as many y as x, found %zd and %zd", y->count, x->count);
    return false;
}

static PyObject *v2x_awareness_service_compute_sigmas(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    DetectionProfile profile;
    double pose[2], *sigmas;
    Array x, y;
    if (!expect_arguments("compute_sigmas", count, 4, 4) || !read_profile(arguments[0], &profile) ||
        !read_fields(arguments[1], &POSE, pose) || !open_places(arguments + 2, &x, &y))
        return NULL;
    Py_ssize_t shape[] = {x.count, 3};
    PyObject *result = new_doubles(2, shape, &sigmas);
    for (Py_ssize_t i = 0; result && i < x.count; i++) {
        double distance = portable_hypot(doubles(&x)[i] - pose[0], doubles(&y)[i] - pose[1]);
        sigmas[3 * i] = compute_spread_at(&profile, distance);
        sigmas[3 * i + 1] = profile.yaw_sigma, sigmas[3 * i + 2] = profile.speed_sigma;
    }
    close_arrays(2, (Array *[]){&x, &y});
    return result;
}

static PyObject *v2x_awareness_service_find_rows_within(PyObject *module, PyObject *const *arguments,
                                                        Py_ssize_t count) {
    double numbers[3]; /* the centre and the reach */
    Array x, y;
    if (!expect_arguments("find_rows_within", count, 5, 5) || !read_numbers(arguments + 2, 3, numbers) ||
        !open_places(arguments, &x, &y))
        return NULL;
    PyObject *result = NULL;
    Py_ssize_t found = 0;
    int64_t *rows;
    for (int pass = 0; pass < 2; pass++) { /* the first one counts */
        found = 0;
        for (Py_ssize_t i = 0; i < x.count; i++) {
            bool is_near = fabs(doubles(&x)[i] - numbers[0]) < numbers[2] && fabs(doubles(&y)[i] - numbers[1]) < numbers[2];
            if (pass && is_near) rows[found] = i;
            found += is_near;
        }
        if (!pass && !(result = new_array('l', 1, &found, (void **)&rows))) break;
    }
    close_arrays(2, (Array *[]){&x, &y});
    return result;
}

Functions v2x_awareness_service = {
    FUNCTION(v2x_awareness_service_compute_sigmas),
    FUNCTION(v2x_awareness_service_find_rows_within),
    END_OF_FUNCTIONS,
};
