/* Line of sight, for other C files: the twins of visibility.py. */
#ifndef MDRIVE_VISIBILITY_H
#define MDRIVE_VISIBILITY_H

#include "../core/state.h"

/* A sensing_frame.SensorPose. */
typedef struct {
    double x, y, yaw;
    Py_ssize_t carrier_row; /* -1: none */
} Eye;
bool read_eye(PyObject *pose, Eye *eye);

/* An edge that faces the eye, as the eye sees it: from right to left, counter-clockwise. */
typedef struct {
    double right, left, cos, sin, extent;
    Py_ssize_t box; /* -1: a wall */
    bool hides;
} Edge;

/* What is around an eye: the distance (boxes,) to each box, and the edges that face the eye, those of boxes first. */
typedef struct {
    Eye eye;
    double range_m;
    Py_ssize_t boxes, edges;
    double *distance;
    Edge *edge;
} Sight;
bool open_sight(const RoadUsers *boxes, Eye eye, double range_m, PyObject *buildings, Sight *sight);
void close_sight(Sight *sight);

/* As the functions of visibility.py; false with Python's error set. */
bool fill_visible_fractions(const Sight *sight, double *fractions);
bool fill_free_sight(const Sight *sight, Py_ssize_t sectors, double *free_m);
#endif
