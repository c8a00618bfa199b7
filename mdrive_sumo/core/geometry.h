/* Plane geometry for other C files: the twins of geometry.py. */
#ifndef MDRIVE_GEOMETRY_H
#define MDRIVE_GEOMETRY_H

#include <stdbool.h>

#include "compiled/values.h"
#include "portable.h"

/* x and y of the corners of a box, counter-clockwise from front left: a row (4, 2) of an array of corners. */
typedef struct {
    double x, y;
} Point;
typedef struct {
    Point corner[4];
} Box;

static inline Box list_corners(double x, double y, double cos, double sin, double length, double width) {
    double ahead_x = cos * length / 2, ahead_y = sin * length / 2, left_x = -sin * width / 2, left_y = cos * width / 2;
    return (Box){{{x + ahead_x + left_x, y + ahead_y + left_y},
                  {x - ahead_x + left_x, y - ahead_y + left_y},
                  {x - ahead_x - left_x, y - ahead_y - left_y},
                  {x + ahead_x - left_x, y + ahead_y - left_y}}};
}

/* As geometry.box_corners; a yaw that is not finite gives corners that are not finite. */
static inline Box box_corners(double x, double y, double yaw, double length, double width) {
    CosSin direction = cos_sin(yaw);
    return list_corners(x, y, direction.cos, direction.sin, length, width);
}

static inline double least(double a, double b) { return a < b ? a : b; }
static inline double greatest(double a, double b) { return a > b ? a : b; }

/* The extremes of a box along an axis; NaN if a corner has one, as NumPy's min and max. */
static inline void project_box(const Box *box, double axis_x, double axis_y, double *low, double *high) {
    double along[4];
    for (int i = 0; i < 4; i++) along[i] = box->corner[i].x * axis_x + box->corner[i].y * axis_y;
    *low = least(least(along[0], along[1]), least(along[2], along[3]));
    *high = greatest(greatest(along[0], along[1]), greatest(along[2], along[3]));
    if (isnan(along[0] + along[1] + along[2] + along[3])) /* or opposite infinities */
        for (int i = 0; i < 4; i++)
            if (isnan(along[i])) *low = *high = NAN;
}

static inline bool overlap_along_sides(const Box *sides, const Box *first, const Box *second) {
    for (int i = 0; i < 2; i++) {
        double x = sides->corner[i + 1].x - sides->corner[i].x, y = sides->corner[i + 1].y - sides->corner[i].y;
        double a_low, a_high, b_low, b_high;
        project_box(first, x, y, &a_low, &a_high);
        project_box(second, x, y, &b_low, &b_high);
        if (!(a_high > b_low && b_high > a_low)) return false;
    }
    return true;
}

/* As geometry.boxes_overlap, of two boxes. */
static inline bool boxes_overlap(const Box *first, const Box *second) {
    return overlap_along_sides(first, first, second) && overlap_along_sides(second, first, second);
}

/* As geometry.wrap_angles, of one: into [-pi, pi). wrap_angle is in portable.h. */
static inline double wrap_half_open(double angle) {
    double turned = angle + PI, rest = turned >= 0.0 && turned < TAU ? turned : fmod(turned, TAU);
    return (rest < 0.0 ? rest + TAU : rest) - PI; /* as Python's and NumPy's %: never negative */
}

/* A row of Polyline._segments (N-1, 6). */
typedef struct {
    double begin, x, y, dx, dy, length;
} Segment;
typedef struct {
    double s, d;
} Frenet;

/* As the functions of geometry.py; count >= 1. */
Py_ssize_t find_segment(const Segment *segments, Py_ssize_t count, double s);
Point compute_point(const Segment *segments, Py_ssize_t count, double s);
Frenet project_on_segments(const Segment *segments, Py_ssize_t count, double x, double y, double low, double high);

/* Shapes that broadcast to one another, as NumPy's. */
typedef struct {
    int dimensions;
    Py_ssize_t shape[MOST_DIMENSIONS], count;
} Broadcast;
/* How far the next element of an array lies along each dimension of the broadcast shape: 0 where it is repeated. */
typedef struct {
    Py_ssize_t step[MOST_DIMENSIONS];
} Steps;
/* Widens the shape by that of an array without its last `inner` dimensions. */
bool broadcast_shape(Broadcast *shape, const Array *array, int inner);
Steps find_steps(const Broadcast *shape, const Array *array, int inner);
/* Elements that follow one another along the last dimension of the broadcast shape: a run. */
static inline Py_ssize_t get_run(const Broadcast *shape) {
    return shape->dimensions ? shape->shape[shape->dimensions - 1] : 1;
}
/* Where the element at `start`, the first of a run, lies, in elements of the array's outer dimensions. */
static inline Py_ssize_t find_run(const Broadcast *shape, const Steps *steps, Py_ssize_t start) {
    Py_ssize_t place = 0;
    if (shape->dimensions) start /= get_run(shape);
    for (int i = shape->dimensions - 2; i >= 0; i--) {
        place += start % shape->shape[i] * steps->step[i];
        start /= shape->shape[i];
    }
    return place;
}
static inline Py_ssize_t get_last_step(const Broadcast *shape, const Steps *steps) {
    return shape->dimensions ? steps->step[shape->dimensions - 1] : 0;
}
#endif
