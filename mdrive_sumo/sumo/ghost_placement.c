/* Twins of ghost_placement.py. */
#include "../core/compiled/values.h"
#include "../core/geometry.h"

typedef struct {
    double least_x, least_y, greatest_x, greatest_y;
} Bounds;

/* NaN touches nothing. */
static bool touch(const Bounds *first, const Bounds *second) {
    return first->least_x <= second->greatest_x && second->least_x <= first->greatest_x &&
           first->least_y <= second->greatest_y && second->least_y <= first->greatest_y;
}

static bool append_pair(PyObject *pairs, Py_ssize_t box, Py_ssize_t area) {
    PyObject *pair = pack(2, PyLong_FromSsize_t(box), PyLong_FromSsize_t(area));
    bool is_added = pair && PyList_Append(pairs, pair) == 0;
    if (pair) Py_DecRef(pair);
    return is_added;
}

static Bounds bound_box(const Box *box) {
    Bounds bounds = {INFINITY, INFINITY, -INFINITY, -INFINITY};
    for (int i = 0; i < 4; i++) {
        double x = box->corner[i].x, y = box->corner[i].y;
        if (isnan(x) || isnan(y)) return (Bounds){NAN, NAN, NAN, NAN};
        bounds.least_x = least(x, bounds.least_x), bounds.least_y = least(y, bounds.least_y);
        bounds.greatest_x = greatest(x, bounds.greatest_x), bounds.greatest_y = greatest(y, bounds.greatest_y);
    }
    return bounds;
}

static PyObject *sumo_ghost_placement_find_near_pairs(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("find_near_pairs", count, 2, 2)) return NULL;
    Array corners, areas;
    if (!open_doubles(arguments[0], 3, &corners)) return NULL;
    if (!open_doubles(arguments[1], 2, &areas)) {
        close_array(&corners);
        return NULL;
    }
    PyObject *pairs = NULL;
    if (corners.shape[1] != 4 || corners.shape[2] != 2 || areas.shape[1] != 4)
        PyErr_SetString(PyExc_ValueError, "expected corners (S, 4, 2) and bounds (L, 4)");
    else pairs = PyList_New(0);
    for (Py_ssize_t i = 0; pairs && i < corners.shape[0]; i++) {
        Bounds box = bound_box((const Box *)corners.data + i);
        for (Py_ssize_t j = 0; pairs && j < areas.shape[0]; j++)
            if (touch(&box, (const Bounds *)areas.data + j) && !append_pair(pairs, i, j)) {
                Py_DecRef(pairs);
                pairs = NULL;
            }
    }
    close_array(&corners);
    close_array(&areas);
    return pairs;
}

Functions sumo_ghost_placement = {FUNCTION(sumo_ghost_placement_find_near_pairs), END_OF_FUNCTIONS};
