/* What controllers share: the twins of plan_reader.py, for other C files. */
#ifndef MDRIVE_PLAN_READER_H
#define MDRIVE_PLAN_READER_H

#include "../../core/compiled/values.h"
#include "../../core/geometry.h"

/* Of an EgoState or OwnState. */
typedef struct {
    double x, y, yaw, speed, acceleration, yaw_rate;
} OwnMotion;
bool read_own_motion(PyObject *object, OwnMotion *own);

/* An open plan: `points` has to be closed. */
typedef struct {
    Array points;
    double interval_s;
} Plan;
bool open_plan(PyObject *object, Plan *plan);

static inline Point point_to_ego_frame(double x, double y, CosSin ahead, const OwnMotion *own) {
    double dx = x - own->x, dy = y - own->y;
    return (Point){ahead.cos * dx + ahead.sin * dy, ahead.cos * dy - ahead.sin * dx};
}

/* As round_control. */
PyObject *build_control(double throttle, double brake, double steer);

#endif
