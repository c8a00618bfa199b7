/* Detection errors, for other C files: the twins of detection_noise.py, of one object. */
#ifndef MDRIVE_DETECTION_NOISE_H
#define MDRIVE_DETECTION_NOISE_H

#include "../contract/detector_profiles.h"
#include "../core/seeding.h"
#include "visibility.h"

/* Purposes of random numbers, of one seed. */
typedef struct {
    Purpose phase, miss, error;
} ErrorDraws;
ErrorDraws start_errors(int64_t seed);

/* An object as a detector tells it. */
typedef struct {
    PyObject *id; /* true id, a reference of its own */
    unsigned char kind;
    double columns[USER_COLUMNS]; /* x, y, yaw, speed, length, width */
    double distance;              /* of its centre from the eye */
} Detection;

/* The epoch of an object and the ticks since its beginning. */
typedef struct {
    int64_t epoch, step;
} EpochTime;
bool find_epoch(const ErrorDraws *draws, PyObject *id, int64_t tick, EpochTime *time);

bool draw_detected(const ErrorDraws *draws, PyObject *id, EpochTime time, double recall, bool *is_detected);
bool add_errors(const DetectionProfile *profile, const ErrorDraws *draws, EpochTime time, Eye eye, Detection *seen);
#endif
