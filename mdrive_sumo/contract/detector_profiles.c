/* Error profiles of detector_profiles.py, for other C files. */
#include "detector_profiles.h"

static const double FAR_M = 100.0;
FIELDS(PROFILE, "recall", "recall_far", "min_visible", "plain_visible", "spread", "spread_doubles_m", "yaw_sigma",
       "size_sigma", "speed_sigma");

bool read_profile(PyObject *object, DetectionProfile *profile) { return read_fields(object, &PROFILE, &profile->recall); }

double compute_recall_at(const DetectionProfile *profile, double distance, double visible) {
    double far = 1.0 - (1.0 - profile->recall_far) * distance / FAR_M;
    double least = profile->plain_visible > 1e-9 ? profile->plain_visible : 1e-9, plain = visible / least;
    if (0.0 > far) far = 0.0;
    plain = plain < 0.0 ? 0.0 : plain > 1.0 ? 1.0 : plain;
    return visible >= profile->min_visible ? profile->recall * far * plain : 0.0;
}
