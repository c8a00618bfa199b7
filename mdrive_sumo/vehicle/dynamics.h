/* The numbers of a car for other C files: the classes of dynamics.py. */
#ifndef MDRIVE_DYNAMICS_H
#define MDRIVE_DYNAMICS_H

#include "../core/compiled/values.h"

/* The fields of VehicleState, in their order. */
typedef struct {
    double x, y, yaw, vx, vy, yaw_rate, steer_angle, drive, brake, acceleration;
} VehicleState;
bool read_vehicle_state(PyObject *object, VehicleState *state);
PyObject *build_vehicle_state(const VehicleState *state);

#endif
