/* Lines with their arc lengths for other C files: the twins of intention.py. */
#ifndef MDRIVE_INTENTION_H
#define MDRIVE_INTENTION_H

#include "../planning/path_overlap.h"

/* Points of a prediction, and the time between two of them. */
enum { POINTS = 20 };
#define INTERVAL_S 0.2

/* The arrays of a MeasuredLine; count >= 1. */
typedef struct {
    Array points, s, direction;
    Py_ssize_t count;
} Line;
bool open_line(PyObject *line, Line *opened);
void close_line(Line *line);
/* The point at a station, as sample_line. */
Point sample_point(const Line *line, double station);
/* A new MeasuredLine; the points are taken, also in an error. */
PyObject *build_measured_line(PyObject *points);
#endif
