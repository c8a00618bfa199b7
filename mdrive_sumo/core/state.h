/* Instances of state.RoadUsers and its subclasses, as other C files read and build them. */
#ifndef MDRIVE_STATE_H
#define MDRIVE_STATE_H

#include "compiled/values.h"

/* As state.Kind. */
enum { VEHICLE, PEDESTRIAN, CYCLIST, STATIC };

/* The columns (count,) of road users. `columns` are x, y, yaw, speed, length, width. */
enum { USER_COLUMNS = 6 };
typedef struct {
    Py_ssize_t count;
    PyObject *ids; /* a tuple of str, a reference of its own */
    Array kind, columns[USER_COLUMNS];
} RoadUsers;

/* Raises ValueError where columns differ in length, TypeError for other objects. */
bool open_road_users(PyObject *object, RoadUsers *users);
void close_road_users(RoadUsers *users);
static inline const unsigned char *kinds_of(const RoadUsers *users) { return users->kind.data; }
static inline const double *x_of(const RoadUsers *users) { return doubles(users->columns); }
static inline const double *y_of(const RoadUsers *users) { return doubles(users->columns + 1); }
static inline const double *yaws_of(const RoadUsers *users) { return doubles(users->columns + 2); }
static inline const double *speeds_of(const RoadUsers *users) { return doubles(users->columns + 3); }
static inline const double *lengths_of(const RoadUsers *users) { return doubles(users->columns + 4); }
static inline const double *widths_of(const RoadUsers *users) { return doubles(users->columns + 5); }

/* Columns of new road users, to be filled; the ids with PyTuple_SetItem. */
typedef struct {
    PyObject *ids, *kind, *columns[USER_COLUMNS];
    unsigned char *kinds;
    double *values[USER_COLUMNS];
} NewRoadUsers;
bool new_road_users(Py_ssize_t count, NewRoadUsers *users);
void drop_road_users(NewRoadUsers *users);

#endif
