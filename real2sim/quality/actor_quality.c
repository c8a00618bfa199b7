/* Twin of actor_quality.py: dynamic time warping. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../../mdrive_sumo/core/compiled/values.h"

static double at_most(double first, double second) { return second < first ? second : first; }

static double sum_least_costs(const double *costs, Py_ssize_t frames, Py_ssize_t width, double *best) {
    Py_ssize_t middle = width / 2;
    double sum = 0.0;
    for (Py_ssize_t k = 0; k < middle; k++) best[k] = INFINITY;
    for (Py_ssize_t k = middle; k < width; k++) best[k] = sum = k == middle ? costs[k] : sum + costs[k];
    for (Py_ssize_t row = 1; row < frames; row++) {
        double left = INFINITY;
        costs += width;
        for (Py_ssize_t k = 0; k < width; k++) {
            double above = k + 1 < width ? at_most(best[k], best[k + 1]) : best[k];
            best[k] = left = at_most(above, left) + costs[k];
        }
    }
    return best[middle];
}

static PyObject *real2sim_quality_actor_quality__sum_least_costs(PyObject *module, PyObject *const *arguments,
                                                                 Py_ssize_t count) {
    Array costs;
    if (!expect_arguments("_sum_least_costs", count, 1, 1) || !open_doubles(arguments[0], 2, &costs)) return NULL;
    PyObject *result = NULL;
    double *best = malloc(costs.shape[1] * sizeof *best + 1);
    if (!best) {
        PyErr_NoMemory();
    } else if (!costs.count) {
        PyErr_SetString(PyExc_ValueError, "expected costs, found none");
    } else {
        result = PyFloat_FromDouble(sum_least_costs(doubles(&costs), costs.shape[0], costs.shape[1], best));
    }
    free(best);
    close_array(&costs);
    return result;
}

Functions real2sim_quality_actor_quality = {
    FUNCTION(real2sim_quality_actor_quality__sum_least_costs),
    END_OF_FUNCTIONS,
};
