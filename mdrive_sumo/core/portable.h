/* Elementary functions that give the same bits on every machine: the twins of portable.py, for other C files. */
#ifndef MDRIVE_PORTABLE_H
#define MDRIVE_PORTABLE_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

enum { TURN_STEPS = 1 << 14, ATAN_STEPS = 1 << 8 };

/* Built from portable_tables.f64 when the layer is loaded (portable.c). */
extern double STEPS_PER_RADIAN, RADIANS_PER_STEP, SIN_3, COS_2;
extern double COS_TABLE[TURN_STEPS], SIN_TABLE[TURN_STEPS], ATAN_TABLE[ATAN_STEPS + 1];

#define PI 3.14159265358979323846
#define HALF_PI (PI / 2)
#define TAU (2 * PI)

typedef struct {
    double cos, sin;
} CosSin;

/* The nearest integer, of two the even one, as Python's round: adding 1.5 * 2^52 leaves no place for a fraction. */
static inline double round_even(double x) {
    const double shift = 6755399441055744.0;
    return fabs(x) < 2251799813685248.0 ? (x + shift) - shift : rint(x);
}

/* `steps` becomes what is left beside the whole step, whose row in the tables is returned. */
static inline int split_steps(double *steps) {
    double whole = round_even(*steps);
    *steps -= whole;
    double turned = fabs(whole) < 4e18 ? whole : fmod(whole, TURN_STEPS);
    return turned == turned ? (int)((int64_t)turned & (TURN_STEPS - 1)) : 0; /* NaN stays NaN by *steps */
}

static inline CosSin cos_sin(double angle) {
    double steps = angle * STEPS_PER_RADIAN;
    int row = split_steps(&steps);
    double cos = COS_TABLE[row], sin = SIN_TABLE[row], square = steps * steps;
    double along = 1.0 - square * COS_2, aside = steps * (RADIANS_PER_STEP - square * SIN_3);
    return (CosSin){cos * along - sin * aside, sin * along + cos * aside};
}

/* The angle whose tangent is a slope in [0, 1], or NaN. */
static inline double atan_of_slope(double slope) {
    if (!(slope <= 1.0)) return NAN;
    double row = round_even(slope * ATAN_STEPS), near = row * (1.0 / ATAN_STEPS);
    double rest = (slope - near) / (1.0 + slope * near), square = rest * rest;
    return ATAN_TABLE[(int)row] + (rest + rest * square * (square * 0.2 - 1.0 / 3));
}

static inline double portable_atan2(double y, double x) {
    double high = fabs(y), low = fabs(x);
    int is_steep = high > low;
    if (!is_steep) high = fabs(x), low = fabs(y);
    double angle = atan_of_slope(low / (1e-300 > high ? 1e-300 : high));
    if (is_steep) angle = HALF_PI - angle;
    if (x < 0.0) angle = PI - angle;
    return y < 0.0 ? -angle : angle;
}

static inline double portable_atan(double slope) {
    double steep = fabs(slope), angle = atan_of_slope(steep > 1.0 ? 1.0 / steep : steep);
    if (steep > 1.0) angle = HALF_PI - angle;
    return slope < 0.0 ? -angle : angle;
}

static inline double portable_sinc(double x) { return x ? cos_sin(PI * x).sin / (PI * x) : 1.0; }

static inline double portable_hypot(double x, double y) { return sqrt(x * x + y * y); }

double portable_exp(double x);
double portable_expm1(double x);
double portable_log(double x);
/* The same of many numbers, which a processor computes several at a time. */
void portable_exp_all(const double *x, double *y, size_t count);
void portable_log_all(const double *x, double *y, size_t count);

/* As geometry.wrap_angle: into (-pi, pi]. */
static inline double wrap_angle(double angle) {
    double wrapped = remainder(angle, TAU);
    return wrapped == -PI ? PI : wrapped;
}
#endif
