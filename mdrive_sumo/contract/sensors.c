/* Outputs of sensors.py, for other C files. */
#include "sensors.h"

static Import OBJECTS = {"mdrive_sumo.contract.sensors", "Objects", 0};
FIELDS(FIELDS_OF_OBJECTS, "ids", "kind", "x", "y", "yaw", "speed", "length", "width", "free_m");

PyObject *build_objects(NewRoadUsers *users, PyObject *free_m) {
    PyObject *values[3 + USER_COLUMNS] = {users->ids, users->kind};
    for (int i = 0; i < USER_COLUMNS; i++) values[2 + i] = users->columns[i];
    values[2 + USER_COLUMNS] = free_m;
    return build_instance(&OBJECTS, &FIELDS_OF_OBJECTS, values);
}
