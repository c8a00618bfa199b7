/* Outputs of sensors as other C files build them: those of sensors.py. */
#ifndef MDRIVE_SENSORS_H
#define MDRIVE_SENSORS_H

#include "../core/state.h"

/* A sensors.Objects; takes the columns and free_m, also in an error. free_m may be NULL, an error. */
PyObject *build_objects(NewRoadUsers *users, PyObject *free_m);
#endif
