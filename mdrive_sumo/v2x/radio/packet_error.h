/* Values of error curves, the twin of packet_error.interpolate, for other C files. */
#ifndef MDRIVE_PACKET_ERROR_H
#define MDRIVE_PACKET_ERROR_H

enum { CURVES = 3 }; /* by class of the link */
static const double STEP_DB = 0.5;

typedef struct {
    const double *values; /* (CURVES, points), points > 1 */
    int points;
    double first_db;
} ErrorCurves;

/* For a finite SINR. Without branches: what interferes is now strong, now weak. */
static inline double interpolate_curve(const ErrorCurves *curves, double sinr_db, unsigned char kind) {
    double place = (sinr_db - curves->first_db) / STEP_DB, last = curves->points - 1.0;
    double inside = place > 0.0 ? place : 0.0;
    inside = inside < last ? inside : last;
    int whole = (int)inside, row = whole < curves->points - 2 ? whole : curves->points - 2;
    double share = inside - row;
    const double *values = curves->values + kind * curves->points + row;
    double value = values[0] * (1.0 - share) + values[1] * share;
    return place < 0.0 ? 1.0 : value;
}
#endif
