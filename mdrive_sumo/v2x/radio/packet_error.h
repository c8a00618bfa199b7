/* Values of error curves, the twin of packet_error.interpolate, for other C files. */
#ifndef MDRIVE_PACKET_ERROR_H
#define MDRIVE_PACKET_ERROR_H

#include <math.h>

enum { CURVES = 3 }; /* by class of the link */
static const double STEP_DB = 0.5;

typedef struct {
    const double *values; /* (CURVES, points), points > 1 */
    int points;
    double first_db;
} ErrorCurves;

static inline double interpolate_curve(const ErrorCurves *curves, double sinr_db, unsigned char kind) {
    double place = (sinr_db - curves->first_db) / STEP_DB;
    if (!(place >= 0.0)) return isnan(place) ? place : 1.0;
    double inside = place < curves->points - 1.0 ? place : curves->points - 1.0;
    int row = (int)inside < curves->points - 2 ? (int)inside : curves->points - 2;
    double share = inside - row;
    const double *values = curves->values + kind * curves->points + row;
    return values[0] * (1.0 - share) + values[1] * share;
}
#endif
