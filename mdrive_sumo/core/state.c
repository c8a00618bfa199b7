/* Road users of state.py, for other C files. */
#include "state.h"

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
