/* Twins of reply_check.py. */
#include <math.h>

#include "../core/compiled/values.h"

static PyObject *contract_reply_check_are_within(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("are_within", count, 2, 2)) return NULL;
    double limit;
    Array values;
    if (!read_number(arguments[1], &limit) || !open_array(arguments[0], 'd', &values)) return NULL;
    bool are_within = true;
    for (Py_ssize_t i = 0; i < values.count; i++) are_within &= fabs(doubles(&values)[i]) <= limit;
    close_array(&values);
    return PyBool_FromLong(are_within);
}

Functions contract_reply_check = {FUNCTION(contract_reply_check_are_within), END_OF_FUNCTIONS};
