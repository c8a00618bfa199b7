/* Error profiles of detectors, for other C files: those of detector_profiles.py. */
#ifndef MDRIVE_DETECTOR_PROFILES_H
#define MDRIVE_DETECTOR_PROFILES_H

#include "../core/compiled/values.h"

/* A detector_profiles.DetectionProfile: its numbers in their order, up to the latency. */
typedef struct {
    double recall, recall_far, min_visible, plain_visible, spread, spread_doubles_m, yaw_sigma, size_sigma, speed_sigma;
} DetectionProfile;
bool read_profile(PyObject *object, DetectionProfile *profile);

/* As the methods of DetectionProfile, of one object. */
double compute_recall_at(const DetectionProfile *profile, double distance, double visible);
static inline double compute_spread_at(const DetectionProfile *profile, double distance) {
    return profile->spread * (1.0 + distance / profile->spread_doubles_m);
}
#endif
