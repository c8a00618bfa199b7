/* Tracks for other C files: see track_states.py. */
#ifndef MDRIVE_TRACK_STATES_H
#define MDRIVE_TRACK_STATES_H

#include "../core/compiled/values.h"
#include "measurements.h"
#include "tracking_parameters.h"

/* A row of type TRACK. */
typedef struct {
    double x, y, vx, vy, position, coupling, velocity, yaw, turn_rate, yaw_variance, yaw_coupling, turn_variance, length,
        width;
    int64_t number, kind, born_tick, seen_tick, confirmed, seen_by_sensor;
    double mean_x, mean_y, mean_vx, mean_vy;
    int64_t mean_count, mean_tick;
} Track;

bool open_tracks(PyObject *object, Array *tracks);
/* New tracks, equal to the first `count` ones. */
PyObject *copy_tracks(const Track *tracks, Py_ssize_t count, Track **copy);
/* Rows (K,) of tracks or measurements: integers in [0, limit). */
bool open_indices(PyObject *object, Py_ssize_t limit, Array *indices);
/* As correct: tracks rows[i], ascending, by measurements new[columns[i]]. */
void correct_tracks(Track *tracks, const int64_t *rows, const Measurement *new, const int64_t *columns, Py_ssize_t count,
                    const TrackingParameters *parameters);
static inline const int64_t *integers(const Array *array) { return array->data; }
#endif
