/* The direction of a road for other C files: the twins of road_direction.py. */
#ifndef MDRIVE_ROAD_DIRECTION_H
#define MDRIVE_ROAD_DIRECTION_H

#include "path_overlap.h"

/* The arrays of a RoadDirection, with at least one row. */
typedef struct {
    Array s, yaw, xy;
} Road;
bool open_road(PyObject *road, Road *opened);
void close_road(Road *road);
double get_road_yaw(const Road *road, double s);
/* As find_points, of one station; NaN is an error. */
bool find_road_point(const Road *road, double s, Point *point);
#endif
