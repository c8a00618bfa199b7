/* Twins of state.py, and its road users for other C files. */
#include "state.h"

#include <stdlib.h>
#include <string.h>

FIELDS(USERS, "ids", "kind", "x", "y", "yaw", "speed", "length", "width");

bool open_road_users(PyObject *object, RoadUsers *users) {
    users->ids = get_field(object, &USERS, 0);
    if (!users->ids) return false;
    users->count = PyTuple_Size(users->ids);
    int opened = 0;
    bool is_valid = users->count >= 0;
    for (; is_valid && opened <= USER_COLUMNS; opened++) {
        PyObject *column = get_field(object, &USERS, opened + 1);
        Array *array = opened ? users->columns + opened - 1 : &users->kind;
        is_valid = column && open_array(column, opened ? 'd' : 'B', array);
        if (column) Py_DecRef(column); /* the array keeps what it needs */
        if (!is_valid) break;
        if (array->dimensions != 1 || array->count != users->count) {
            PyErr_Format(PyExc_ValueError, "expected columns with %zd rows, one for each id, found %zd", users->count,
                         array->count);
            is_valid = false;
        }
    }
    if (is_valid) return true;
    for (int i = 0; i < opened; i++) close_array(i ? users->columns + i - 1 : &users->kind);
    Py_DecRef(users->ids);
    return false;
}

void close_road_users(RoadUsers *users) {
    close_array(&users->kind);
    for (int i = 0; i < USER_COLUMNS; i++) close_array(users->columns + i);
    Py_DecRef(users->ids);
}

bool new_road_users(Py_ssize_t count, NewRoadUsers *users) {
    *users = (NewRoadUsers){.ids = PyTuple_New(count)};
    users->kind = new_array('B', 1, &count, (void **)&users->kinds);
    bool is_complete = users->ids && users->kind;
    for (int i = 0; is_complete && i < USER_COLUMNS; i++)
        is_complete = (users->columns[i] = new_doubles(1, &count, users->values + i)) != NULL;
    if (!is_complete) drop_road_users(users);
    return is_complete;
}

void drop_road_users(NewRoadUsers *users) {
    if (users->ids) Py_DecRef(users->ids);
    if (users->kind) Py_DecRef(users->kind);
    for (int i = 0; i < USER_COLUMNS; i++)
        if (users->columns[i]) Py_DecRef(users->columns[i]);
}

/* The columns as a tuple; takes them, also in an error. */
static PyObject *pack_columns(NewRoadUsers *users) {
    PyObject **columns = users->columns;
    Py_DecRef(users->ids);
    return pack(1 + USER_COLUMNS, users->kind, columns[0], columns[1], columns[2], columns[3], columns[4], columns[5]);
}

FIELDS(EGO, "x", "y", "yaw", "speed");

static bool read_ego(PyObject *ego, PyObject *size, double row[USER_COLUMNS]) {
    PyObject *numbers[2] = {PySequence_GetItem(size, 0), PySequence_GetItem(size, 1)};
    bool is_read = numbers[0] && numbers[1] && read_numbers(numbers, 2, row + 4) && read_fields(ego, &EGO, row);
    for (int i = 0; i < 2; i++)
        if (numbers[i]) Py_DecRef(numbers[i]);
    return is_read;
}

static PyObject *core_state_build_ego_columns(PyObject *module, PyObject *const *arguments, Py_ssize_t argument_count) {
    if (!expect_arguments("build_ego_columns", argument_count, 2, 2)) return NULL;
    Py_ssize_t count = PyList_Size(arguments[0]), sizes = PyList_Size(arguments[1]);
    if (count < 0 || sizes < 0) return NULL;
    if (count != sizes) return PyErr_Format(PyExc_ValueError, "expected %zd sizes, found %zd", count, sizes);
    NewRoadUsers users;
    if (!new_road_users(count, &users)) return NULL;
    for (Py_ssize_t i = 0; i < count; i++) {
        double row[USER_COLUMNS];
        if (!read_ego(PyList_GetItem(arguments[0], i), PyList_GetItem(arguments[1], i), row)) {
            drop_road_users(&users);
            return NULL;
        }
        users.kinds[i] = VEHICLE;
        for (int k = 0; k < USER_COLUMNS; k++) users.values[k][i] = row[k];
    }
    return pack_columns(&users);
}

static void copy_columns(const RoadUsers *part, Py_ssize_t start, NewRoadUsers *users) {
    memcpy(users->kinds + start, kinds_of(part), part->count);
    for (int k = 0; k < USER_COLUMNS; k++)
        memcpy(users->values[k] + start, doubles(part->columns + k), part->count * sizeof(double));
}

static PyObject *core_state_join_columns(PyObject *module, PyObject *const *arguments, Py_ssize_t argument_count) {
    if (!expect_arguments("join_columns", argument_count, 1, 1)) return NULL;
    Py_ssize_t count = PyList_Size(arguments[0]), opened = 0, rows = 0;
    if (count < 0) return NULL;
    RoadUsers *parts = malloc((count + 1) * sizeof *parts);
    if (!parts) return PyErr_NoMemory();
    while (opened < count && open_road_users(PyList_GetItem(arguments[0], opened), parts + opened))
        rows += parts[opened++].count;
    NewRoadUsers users;
    bool is_valid = opened == count && new_road_users(rows, &users);
    for (Py_ssize_t i = 0, start = 0; i < opened; i++) {
        if (is_valid) copy_columns(parts + i, start, &users);
        start += parts[i].count;
        close_road_users(parts + i);
    }
    free(parts);
    return is_valid ? pack_columns(&users) : NULL;
}

/* The row of the joined parts; negative ones count from the end. */
static bool copy_row(const RoadUsers *parts, Py_ssize_t count, Py_ssize_t row, Py_ssize_t all, NewRoadUsers *users,
                     Py_ssize_t to) {
    if (row < 0) row += all;
    if (row < 0 || row >= all) {
        PyErr_Format(PyExc_ValueError, "expected rows below %zd, found %zd", all, row);
        return false;
    }
    while (row >= parts->count) row -= parts->count, parts++;
    users->kinds[to] = kinds_of(parts)[row];
    for (int k = 0; k < USER_COLUMNS; k++) users->values[k][to] = doubles(parts->columns + k)[row];
    return true;
}

static PyObject *core_state_select_columns(PyObject *module, PyObject *const *arguments, Py_ssize_t argument_count) {
    if (!expect_arguments("select_columns", argument_count, 2, 2)) return NULL;
    Py_ssize_t count = PyList_Size(arguments[0]), opened = 0, all = 0;
    Array rows;
    RoadUsers parts[2];
    if (count < 0 || !open_array(arguments[1], 'l', &rows)) return NULL;
    if (count > 2) PyErr_SetString(PyExc_ValueError, "expected at most two parts");
    while (count <= 2 && opened < count && open_road_users(PyList_GetItem(arguments[0], opened), parts + opened))
        all += parts[opened++].count;
    NewRoadUsers users;
    bool is_new = opened == count && new_road_users(rows.count, &users), is_valid = is_new;
    for (Py_ssize_t i = 0; is_valid && i < rows.count; i++)
        is_valid = copy_row(parts, count, (Py_ssize_t)((const int64_t *)rows.data)[i], all, &users, i);
    for (Py_ssize_t i = 0; i < opened; i++) close_road_users(parts + i);
    close_array(&rows);
    if (is_new && !is_valid) drop_road_users(&users);
    return is_valid ? pack_columns(&users) : NULL;
}

Functions core_state = {
    FUNCTION(core_state_build_ego_columns),
    FUNCTION(core_state_join_columns),
    FUNCTION(core_state_select_columns),
    END_OF_FUNCTIONS,
};
