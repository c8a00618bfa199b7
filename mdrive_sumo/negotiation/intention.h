/* Lines with their arc lengths for other C files: the twins of intention.py. */
#ifndef MDRIVE_INTENTION_H
#define MDRIVE_INTENTION_H

#include "../core/geometry.h"

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

/* As numpy.interp of one x, between y[0], y[step], ...; count >= 1 */
static inline double interpolate(double x, const double *xs, const double *y, Py_ssize_t step, Py_ssize_t count) {
    if (x != x && count > 1) return x;
    if (x < xs[0]) return y[0];
    if (!(x < xs[count - 1])) return y[(count - 1) * step];
    Py_ssize_t low = 0, high = count - 1; /* xs[low] <= x < xs[high] */
    while (high - low > 1) {
        Py_ssize_t middle = (low + high) / 2;
        if (xs[middle] <= x) low = middle;
        else high = middle;
    }
    double before = y[low * step], after = y[(low + 1) * step];
    if (xs[low] == x) return before;
    double slope = (after - before) / (xs[low + 1] - xs[low]), value = slope * (x - xs[low]) + before;
    if (value == value) return value;
    value = slope * (x - xs[low + 1]) + after;
    return value != value && before == after ? before : value;
}
#endif
