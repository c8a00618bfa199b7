/* Measurements for other C files: see measurements.py. */
#ifndef MDRIVE_MEASUREMENTS_H
#define MDRIVE_MEASUREMENTS_H

#include "../core/compiled/values.h"

/* A row of type MEASUREMENT. */
typedef struct {
    int64_t source, kind;
    double x, y, vx, vy, yaw, length, width, position, bias, yaw_variance, speed_variance;
} Measurement;

/* Measurements.sources, names and rows. */
typedef struct {
    PyObject *sources, *names; /* tuples */
    Array rows;
    const Measurement *row;
    Py_ssize_t count;
    bool is_own; /* whether the first source is the own sensor */
} OpenMeasurements;
bool open_measurements(PyObject *object, OpenMeasurements *open);
void close_measurements(OpenMeasurements *open);
#endif
