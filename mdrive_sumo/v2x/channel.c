/* Twins of channel.py: distances and random numbers for all receivers of a message. */
#include "../core/portable.h"
#include "../core/seeding.h"
#include "../core/compiled/values.h"

static Import MESSAGE = {"mdrive_sumo.contract.exchange", "Message", 0};
FIELDS(MESSAGE_FIELDS, "type", "payload", "sender", "tick");

static PyObject *v2x_channel_sign_messages(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("sign_messages", count, 3, 3)) return NULL;
    Py_ssize_t messages = PyObject_Size(arguments[0]);
    PyObject *result = messages < 0 ? NULL : PyList_New(messages);
    for (Py_ssize_t i = 0; result && i < messages; i++) {
        PyObject *unsigned_message = PySequence_GetItem(arguments[0], i), *values[4] = {0}, *message = NULL;
        if (unsigned_message) {
            for (int k = 0; k < 2; k++) values[k] = get_field(unsigned_message, &MESSAGE_FIELDS, k);
            for (int k = 2; k < 4; k++) values[k] = new_reference(arguments[k - 1]);
            message = build_instance(&MESSAGE, &MESSAGE_FIELDS, values);
            Py_DecRef(unsigned_message);
        }
        if (!message || PyList_SetItem(result, i, message)) {
            Py_DecRef(result);
            result = NULL;
        }
    }
    return result;
}

static bool read_position(PyObject *positions, PyObject *name, double place[2]) {
    PyObject *position = PyObject_GetItem(positions, name);
    if (!position) return false;
    bool is_read = true;
    for (int i = 0; is_read && i < 2; i++) {
        PyObject *number = PySequence_GetItem(position, i);
        is_read = number && read_number(number, place + i);
        if (number) Py_DecRef(number);
    }
    Py_DecRef(position);
    return is_read;
}

static bool add_distance(PyObject *distances, PyObject *positions, const double from[2], PyObject *receiver) {
    double to[2];
    if (!read_position(positions, receiver, to)) return false;
    PyObject *distance = PyFloat_FromDouble(portable_hypot(to[0] - from[0], to[1] - from[1]));
    bool is_added = distance && !PyDict_SetItem(distances, receiver, distance);
    if (distance) Py_DecRef(distance);
    return is_added;
}

static PyObject *v2x_channel_measure_distances(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double from[2];
    if (!expect_arguments("measure_distances", count, 3, 3) || !read_position(arguments[0], arguments[1], from))
        return NULL;
    PyObject *distances = PyDict_New();
    Py_ssize_t receivers = PyObject_Size(arguments[2]);
    bool is_valid = distances && receivers >= 0;
    for (Py_ssize_t i = 0; is_valid && i < receivers; i++) {
        PyObject *receiver = PySequence_GetItem(arguments[2], i);
        is_valid = receiver && (!PyUnicode_Compare(receiver, arguments[1]) ||
                                add_distance(distances, arguments[0], from, receiver));
        is_valid = is_valid && !PyErr_Occurred();
        if (receiver) Py_DecRef(receiver);
    }
    if (is_valid) return distances;
    if (distances) Py_DecRef(distances);
    return NULL;
}

/* Fills column i of the rows (UNIFORMS,) of numbers. */
static bool draw_column(const Purpose *sender, PyObject *receiver, PyObject *n, PyObject *block, Py_ssize_t i,
                        PyObject **rows) {
    Purpose purpose = *sender;
    if (!add_object(&purpose, receiver) || !add_object(&purpose, n) || !add_object(&purpose, block)) return false;
    double drawn[UNIFORMS];
    draw_uniforms(&purpose, drawn);
    for (int k = 0; k < UNIFORMS; k++) {
        PyObject *number = PyFloat_FromDouble(drawn[k]);
        if (!number || PyTuple_SetItem(rows[k], i, number)) return false;
    }
    return true;
}

static PyObject *v2x_channel_draw_lucks(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Py_ssize_t seed;
    if (!expect_arguments("draw_lucks", count, 5, 5) || !read_integer(arguments[0], &seed)) return NULL;
    Purpose purpose = start_purpose(seed);
    add_text(&purpose, "loss", 4);
    Py_ssize_t receivers = PyTuple_Size(arguments[3]);
    PyObject *rows[UNIFORMS] = {0}, *result = PyTuple_New(UNIFORMS);
    bool is_valid = result && receivers >= 0 && add_object(&purpose, arguments[1]);
    for (int k = 0; is_valid && k < UNIFORMS; k++)
        is_valid = (rows[k] = PyTuple_New(receivers)) && !PyTuple_SetItem(result, k, rows[k]);
    for (Py_ssize_t i = 0; is_valid && i < receivers; i++)
        is_valid = draw_column(&purpose, PyTuple_GetItem(arguments[3], i), arguments[2], arguments[4], i, rows);
    if (is_valid) return result;
    if (result) Py_DecRef(result);
    return NULL;
}

static Import DELIVERY = {"mdrive_sumo.v2x.channel", "Delivery", 0},
              STATUS = {"mdrive_sumo.v2x.channel", "DeliveryStatus", 0};

static bool add_delivery(PyObject *deliveries, PyObject *receiver, const char *status_name, PyObject *tick) {
    PyObject *type = find_import(&DELIVERY), *statuses = type ? find_import(&STATUS) : NULL;
    PyObject *status = statuses ? PyObject_GetAttrString(statuses, status_name) : NULL;
    PyObject *delivery = status ? PyObject_CallFunctionObjArgs(type, status, tick, NULL) : NULL;
    bool is_added = delivery && !PyDict_SetItem(deliveries, receiver, delivery);
    if (status) Py_DecRef(status);
    if (delivery) Py_DecRef(delivery);
    return is_added;
}

static PyObject *v2x_channel_select_reached(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double range_m, loss, distance, luck = 0.0;
    if (!expect_arguments("select_reached", count, 6, 6) || !read_number(arguments[2], &range_m) ||
        !read_number(arguments[3], &loss) || !is_dict(arguments[1]))
        return NULL;
    PyObject *reached = PyList_New(0), *receiver, *value;
    bool is_valid = reached;
    Py_ssize_t position = 0;
    for (Py_ssize_t i = 0; is_valid && PyDict_Next(arguments[1], &position, &receiver, &value); i++) {
        PyObject *drawn = loss != 0.0 ? PyTuple_GetItem(arguments[4], i) : NULL;
        is_valid = read_number(value, &distance) && (loss == 0.0 || (drawn && read_number(drawn, &luck)));
        if (!is_valid) break;
        if (distance > range_m) is_valid = add_delivery(arguments[5], receiver, "OUT_OF_RANGE", arguments[0]);
        else if (loss != 0.0 && luck < loss) is_valid = add_delivery(arguments[5], receiver, "LOST", arguments[0]);
        else is_valid = !PyList_Append(reached, receiver);
    }
    if (is_valid) return reached;
    if (reached) Py_DecRef(reached);
    return NULL;
}

static PyObject *v2x_channel_hand_over(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("hand_over", count, 6, 6) || !is_dict(arguments[2]) || !is_dict(arguments[3])) return NULL;
    Py_ssize_t receivers = PyList_Size(arguments[0]);
    bool is_valid = receivers >= 0 && PyList_Size(arguments[1]) == receivers;
    if (!is_valid && !PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected a message of each receiver");
    for (Py_ssize_t i = 0; is_valid && i < receivers; i++) {
        PyObject *receiver = PyList_GetItem(arguments[0], i);
        PyObject *inbox = PyDict_GetItemWithError(arguments[2], receiver);
        is_valid = !PyErr_Occurred() && !PyDict_SetItem(arguments[3], receiver, arguments[inbox ? 4 : 5]) &&
                   (!inbox || !PyList_Append(inbox, PyList_GetItem(arguments[1], i)));
    }
    return is_valid ? new_reference(&_Py_NoneStruct) : NULL;
}

Functions v2x_channel = {
    FUNCTION(v2x_channel_sign_messages),
    FUNCTION(v2x_channel_measure_distances),
    FUNCTION(v2x_channel_draw_lucks),
    FUNCTION(v2x_channel_select_reached),
    FUNCTION(v2x_channel_hand_over),
    END_OF_FUNCTIONS,
};
