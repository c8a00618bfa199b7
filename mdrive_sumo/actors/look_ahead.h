/* What actors see on their paths: the functions of look_ahead.py for collision_avoidance.c. */
#ifndef MDRIVE_LOOK_AHEAD_H
#define MDRIVE_LOOK_AHEAD_H

#include "../core/geometry.h"
#include "movers.h"

/* A row of type SURROUNDING, with the direction of its yaw. */
typedef struct {
    double x, y, yaw, speed, half_length, half_width;
    bool is_pedestrian, is_cav;
    Py_ssize_t index; /* among the movers, or one of these */
    CosSin heading;
} Surrounding;
enum { NO_MOVER = -1, STATIC_ACTOR = -2 };

/* The greatest speed of a mover, and the surrounding that limits it, -1 if none does. */
typedef struct {
    double speed;
    Py_ssize_t blocker;
} FreeSpeed;

/* An actor that looks ahead, and the points of its path that it looks at. */
enum { SAMPLES = 16 };
typedef struct {
    const Mover *mover;
    const Knot *knots;
    Py_ssize_t row;
    double half_width, reach;
    bool is_sampled;
    double x[SAMPLES], y[SAMPLES];
    CosSin direction[SAMPLES];
} Looker;
Looker start_looking(const MoversOnPaths *open, Py_ssize_t row);
/* Lets the other limit the free speed. False, with an error, where an angle is not finite. */
bool limit_speed(Looker *looker, const Surrounding *other, Py_ssize_t number, FreeSpeed *free);
#endif
