/* Twins of portable.py: numbers, and arrays element by element. */
#include "portable.h"

#include "compiled/values.h"

double STEPS_PER_RADIAN, RADIANS_PER_STEP, SIN_3, COS_2;
double COS_TABLE[TURN_STEPS], SIN_TABLE[TURN_STEPS], ATAN_TABLE[ATAN_STEPS + 1];

enum { EIGHTH = TURN_STEPS / 8 };
_Alignas(double) static const unsigned char FILE_BYTES[] = {
#embed "portable_tables.f64"
};

/* As portable_tables.arrange_tables: the file holds an eighth of a turn. */
__attribute__((constructor)) static void arrange_tables(void) {
    const double *constants = (const double *)FILE_BYTES, *cosines = constants + 2, *sines = cosines + EIGHTH + 1;
    const double *tangents = sines + EIGHTH + 1;
    STEPS_PER_RADIAN = constants[0], RADIANS_PER_STEP = constants[1];
    SIN_3 = RADIANS_PER_STEP * RADIANS_PER_STEP * RADIANS_PER_STEP / 6;
    COS_2 = RADIANS_PER_STEP * RADIANS_PER_STEP * (0.5 - 0.828 * (RADIANS_PER_STEP / 2) * (RADIANS_PER_STEP / 2) / 24);
    for (int i = 0; i <= TURN_STEPS / 4; i++) {
        double cosine = i <= EIGHTH ? cosines[i] : sines[TURN_STEPS / 4 - i];
        COS_TABLE[i] = cosine;
        if (i) COS_TABLE[TURN_STEPS - i] = cosine;
        if (i < TURN_STEPS / 4) COS_TABLE[TURN_STEPS / 2 - i] = COS_TABLE[TURN_STEPS / 2 + i & TURN_STEPS - 1] = -cosine;
    }
    for (int i = 0; i < TURN_STEPS; i++) SIN_TABLE[i] = COS_TABLE[(i - TURN_STEPS / 4) & (TURN_STEPS - 1)];
    for (int i = 0; i <= ATAN_STEPS; i++) ATAN_TABLE[i] = tangents[i];
}

static inline double evaluate(const double *coefficients, int count, double x) {
    double value = coefficients[0] * x + coefficients[1];
    for (int i = 2; i < count; i++) value = value * x + coefficients[i];
    return value;
}

static const double LN2_HIGH = 6.93147180369123816490e-01, LN2_LOW = 1.90821492927058770002e-10;
static const double FACTORIALS[] = {1.0 / 6227020800, 1.0 / 479001600, 1.0 / 39916800, 1.0 / 3628800,
                                    1.0 / 362880,     1.0 / 40320,     1.0 / 5040,     1.0 / 720,
                                    1.0 / 120,        1.0 / 24,        1.0 / 6,        1.0 / 2};
static const double ODD[] = {1.0 / 21, 1.0 / 19, 1.0 / 17, 1.0 / 15, 1.0 / 13,
                             1.0 / 11, 1.0 / 9,  1.0 / 7,  1.0 / 5,  1.0 / 3};

double portable_exp(double x) {
    x = x < -1e4 ? -1e4 : x > 1e4 ? 1e4 : x;
    if (isnan(x)) return x;
    double power = round_even(x * 1.44269504088896338700);
    double rest = x - power * LN2_HIGH - power * LN2_LOW;
    return ldexp(1.0 + (rest + rest * rest * evaluate(FACTORIALS, 12, rest)), (int)power);
}

double portable_expm1(double x) {
    return fabs(x) < 0.34 ? x + x * x * evaluate(FACTORIALS, 12, x) : portable_exp(x) - 1.0;
}

double portable_log(double x) {
    if (!(x > 0.0 && x < INFINITY)) return NAN;
    int power;
    double mantissa = frexp(x, &power);
    if (mantissa < 0.7071067811865476) mantissa *= 2.0, power -= 1;
    double share = (mantissa - 1.0) / (mantissa + 1.0), square = share * share;
    double tail = 2.0 * (share * square) * evaluate(ODD, 10, square);
    return power * LN2_HIGH + (2.0 * share + (tail + power * LN2_LOW));
}

/* Results are normal numbers where |x| is below that: then a power of two is added to the exponent, as ldexp does. */
static const double MODERATE = 700.0;

void portable_exp_all(const double *restrict x, double *restrict y, size_t count) {
    const double shift = 6755399441055744.0; /* as round_even; the last bits of the sum are the integer */
    for (size_t i = 0; i < count; i++) {
        double shifted = x[i] * 1.44269504088896338700 + shift, power = shifted - shift;
        double rest = x[i] - power * LN2_HIGH - power * LN2_LOW;
        uint64_t bits = (__builtin_bit_cast(uint64_t, shifted) + 1023) << 52;
        y[i] = (1.0 + (rest + rest * rest * evaluate(FACTORIALS, 12, rest))) * __builtin_bit_cast(double, bits);
    }
    for (size_t i = 0; i < count; i++)
        if (!(fabs(x[i]) < MODERATE)) y[i] = portable_exp(x[i]);
}

void portable_log_all(const double *restrict x, double *restrict y, size_t count) {
    for (size_t i = 0; i < count; i++) {
        uint64_t bits = __builtin_bit_cast(uint64_t, x[i]), half = (bits & 0x000fffffffffffff) | 0x3fe0000000000000;
        double mantissa = __builtin_bit_cast(double, half); /* in [0.5, 1) */
        double power = __builtin_bit_cast(double, bits >> 52 | 0x4330000000000000) - (0x1p52 + 1022.0);
        double is_low = mantissa < 0.7071067811865476 ? 1.0 : 0.0;
        mantissa += mantissa * is_low, power -= is_low;
        double share = (mantissa - 1.0) / (mantissa + 1.0), square = share * share;
        double tail = 2.0 * (share * square) * evaluate(ODD, 10, square);
        y[i] = power * LN2_HIGH + (2.0 * share + (tail + power * LN2_LOW));
    }
    for (size_t i = 0; i < count; i++)
        if (!(x[i] >= 0x1p-1022 && x[i] < INFINITY)) y[i] = portable_log(x[i]);
}

static double portable_tan(double angle) {
    CosSin direction = cos_sin(angle);
    return direction.sin / direction.cos;
}

static double only_cos(double angle) { return cos_sin(angle).cos; }
static double only_sin(double angle) { return cos_sin(angle).sin; }

static PyObject *refuse(double value) {
    if (isnan(value)) PyErr_SetString(PyExc_ValueError, "cannot convert float NaN to integer");
    else PyErr_SetString(PyExc_OverflowError, "cannot convert float infinity to integer");
    return NULL;
}

/* A function of one number, for a number or an array; results that are not finite are refused. */
typedef double Function(double x);
typedef void FunctionOfAll(const double *x, double *y, size_t count); /* NULL: one number after another */

static PyObject *map_one(Function *function, FunctionOfAll *function_of_all, PyObject *argument) {
    double x;
    if (!is_array(argument)) {
        if (!read_number(argument, &x)) return NULL;
        double y = function(x);
        return isfinite(y) ? PyFloat_FromDouble(y) : refuse(y);
    }
    Array from;
    if (!open_array(argument, 'd', &from)) return NULL;
    double *to;
    PyObject *result = new_doubles(from.dimensions, from.shape, &to);
    if (result && function_of_all) function_of_all(doubles(&from), to, (size_t)from.count);
    for (Py_ssize_t i = 0; result && i < from.count; i++) {
        if (!function_of_all) to[i] = function(doubles(&from)[i]);
        if (!isfinite(to[i])) {
            Py_DecRef(result);
            result = refuse(to[i]);
        }
    }
    close_array(&from);
    return result;
}

static PyObject *core_portable_cos_sin(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("cos_sin", count, 1, 1)) return NULL;
    double angle;
    if (!is_array(arguments[0])) {
        if (!read_number(arguments[0], &angle)) return NULL;
        CosSin direction = cos_sin(angle);
        if (!isfinite(direction.cos)) return refuse(angle);
        return build_tuple(2, (double[]){direction.cos, direction.sin});
    }
    Array from;
    if (!open_array(arguments[0], 'd', &from)) return NULL;
    double *cosines, *sines, bad = 0.0;
    PyObject *first = new_doubles(from.dimensions, from.shape, &cosines);
    PyObject *second = first ? new_doubles(from.dimensions, from.shape, &sines) : NULL;
    for (Py_ssize_t i = 0; second && i < from.count; i++) {
        CosSin direction = cos_sin(doubles(&from)[i]);
        cosines[i] = direction.cos, sines[i] = direction.sin;
        if (!isfinite(direction.cos)) bad = doubles(&from)[i];
    }
    close_array(&from);
    PyObject *result = second || !first ? NULL : (Py_DecRef(first), NULL);
    if (second) result = pack(2, first, second);
    if (result && bad != 0.0) {
        Py_DecRef(result);
        return refuse(bad);
    }
    return result;
}

#define MAP_ONE(name, function, function_of_all)                                                           \
    static PyObject *core_portable_##name(PyObject *module, PyObject *const *arguments, Py_ssize_t count) { \
        return expect_arguments(#name, count, 1, 1) ? map_one(function, function_of_all, arguments[0]) : NULL; \
    }
MAP_ONE(cos, only_cos, NULL)
MAP_ONE(sin, only_sin, NULL)
MAP_ONE(tan, portable_tan, NULL)
MAP_ONE(sinc, portable_sinc, NULL)
MAP_ONE(atan, portable_atan, NULL)
MAP_ONE(exp, portable_exp, portable_exp_all)
MAP_ONE(expm1, portable_expm1, NULL)
MAP_ONE(log, portable_log, portable_log_all)

static Import BROADCAST = {"numpy", "broadcast_arrays", 0};

static bool have_one_shape(const Array *first, const Array *second) {
    if (first->dimensions != second->dimensions) return false;
    for (int i = 0; i < first->dimensions; i++)
        if (first->shape[i] != second->shape[i]) return false;
    return true;
}

typedef struct {
    double (*of)(double y, double x);
    bool refuses_nan;
} Binary;

static PyObject *map_arrays(Binary function, PyObject *const *pair, bool may_broadcast) {
    Array first, second;
    if (!open_array(pair[0], 'd', &first)) return NULL;
    if (!open_array(pair[1], 'd', &second)) {
        close_array(&first);
        return NULL;
    }
    PyObject *result = NULL;
    if (have_one_shape(&first, &second)) {
        double *to;
        result = new_doubles(first.dimensions, first.shape, &to);
        for (Py_ssize_t i = 0; result && i < first.count; i++) {
            to[i] = function.of(doubles(&first)[i], doubles(&second)[i]);
            if (function.refuses_nan && isnan(to[i])) {
                Py_DecRef(result);
                result = refuse(to[i]);
            }
        }
    } else if (may_broadcast) {
        PyObject *broadcast = find_import(&BROADCAST);
        PyObject *both = broadcast ? PyObject_CallFunctionObjArgs(broadcast, pair[0], pair[1], NULL) : NULL;
        PyObject *left = both ? PySequence_GetItem(both, 0) : NULL, *right = left ? PySequence_GetItem(both, 1) : NULL;
        if (right) result = map_arrays(function, (PyObject *[]){left, right}, false);
        if (left) Py_DecRef(left);
        if (right) Py_DecRef(right);
        if (both) Py_DecRef(both);
    } else {
        PyErr_SetString(PyExc_ValueError, "expected arrays that broadcast");
    }
    close_array(&first);
    close_array(&second);
    return result;
}

/* A function of two numbers, or of arrays and numbers that broadcast. */
static PyObject *map_two(Binary function, PyObject *const *pair) {
    if (is_array(pair[0]) || is_array(pair[1])) return map_arrays(function, pair, true);
    double x, y;
    if (!read_number(pair[0], &x) || !read_number(pair[1], &y)) return NULL;
    double z = function.of(x, y);
    return function.refuses_nan && isnan(z) ? refuse(z) : PyFloat_FromDouble(z);
}

static PyObject *core_portable_atan2(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    return expect_arguments("atan2", count, 2, 2) ? map_two((Binary){portable_atan2, true}, arguments) : NULL;
}

static PyObject *core_portable_hypot(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    return expect_arguments("hypot", count, 2, 2) ? map_two((Binary){portable_hypot, false}, arguments) : NULL;
}

Functions core_portable = {
    FUNCTION(core_portable_cos_sin),
    FUNCTION(core_portable_cos),
    FUNCTION(core_portable_sin),
    FUNCTION(core_portable_tan),
    FUNCTION(core_portable_sinc),
    FUNCTION(core_portable_atan2),
    FUNCTION(core_portable_atan),
    FUNCTION(core_portable_hypot),
    FUNCTION(core_portable_exp),
    FUNCTION(core_portable_expm1),
    FUNCTION(core_portable_log),
    END_OF_FUNCTIONS,
};
