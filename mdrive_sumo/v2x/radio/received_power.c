/* Twin of received_power.py. */
#include <math.h>
#include <stdlib.h>

#include "../../core/compiled/values.h"
#include "../../core/portable.h"
#include "link_class.h"

enum { WAVE_NUMBERS = 5 };
static const double PER_LN10 = 0.43429448190325182765, LEAST_DISTANCE_M = 1.0, SOURCE_SIGMA_DB = 4.1;

enum { XY, HEIGHT, CLASSES, BLOCKER, SHADOWING, BLOCKAGE, CORNER, ARRAYS };

typedef struct {
    const double *xy, *height, *blocker, *corner; /* corner: NULL for another model */
    const unsigned char *classes;
    const double *shadowing, *blockage, *formulas;
    Py_ssize_t shadowing_waves, blockage_waves, n, total;
    double sent_dbm;
} Scene;

/* A pair of antennas, the first of which is a station. */
typedef struct {
    const double *from, *to;
    double slopes, low, high, top;
    unsigned char kind;
} Pair;

/* The waves are added one after another, the first one first. */
static double evaluate_field(const double *waves, Py_ssize_t count, const double *first, const double *second) {
    double total = 0.0;
    for (Py_ssize_t i = 0; i < count; i++) {
        const double *wave = waves + WAVE_NUMBERS * i;
        double phase = wave[4] + wave[0] * first[0] + wave[1] * first[1] + wave[2] * second[0] + wave[3] * second[1];
        total = i ? total + cos_sin(phase).cos : cos_sin(phase).cos;
    }
    return total * sqrt(2.0 / (double)count);
}

static double measure_distance(const Scene *scene, Py_ssize_t i, Py_ssize_t k) {
    const double *from = scene->xy + 2 * i, *to = scene->xy + 2 * k;
    double dx = from[0] - to[0], dy = from[1] - to[1], across = scene->height[i] - scene->height[k];
    double distance = sqrt(dx * dx + dy * dy + across * across);
    return distance < LEAST_DISTANCE_M ? LEAST_DISTANCE_M : distance;
}

static Pair open_pair(const Scene *scene, Py_ssize_t i, Py_ssize_t k, double log_distance) {
    double a = scene->height[i], b = scene->height[k];
    Py_ssize_t place = i * scene->total + k;
    return (Pair){scene->xy + 2 * i, scene->xy + 2 * k, log_distance * PER_LN10, a < b ? a : b, a < b ? b : a,
                  scene->blocker[place], scene->classes[place]};
}

static double compute_path_loss(const Scene *scene, const Pair *pair, unsigned char kind) {
    const double *formula = scene->formulas + (kind == NLOSB ? 2 : 0);
    return formula[0] + formula[1] * pair->slopes;
}

static double compute_blockage(const Scene *scene, const Pair *pair, bool is_known) {
    double far = 15.0 * pair->slopes - 41.0, mean = 0.0, sigma = 0.0;
    if (!(far > 0.0)) far = 0.0;
    if (!(pair->low > pair->top)) {
        bool is_higher = pair->high < pair->top;
        mean = (is_higher ? 9.0 : 5.0) + far;
        sigma = is_higher ? 4.5 : 4.0;
    }
    if (!is_known) return mean;
    double loss = mean + sigma * evaluate_field(scene->blockage, scene->blockage_waves, pair->from, pair->to);
    return loss > 0.0 || isnan(loss) ? loss : 0.0;
}

static double receive(const Scene *scene, Py_ssize_t i, Py_ssize_t k, double log_distance) {
    static const double shadowing_db[] = {3.0, 3.0, 4.0};
    Pair pair = open_pair(scene, i, k, log_distance);
    bool is_known = k < scene->n;
    double loss = compute_path_loss(scene, &pair, pair.kind);
    if (is_known) {
        double sigma = shadowing_db[pair.kind];
        double around = scene->corner ? scene->corner[i * scene->n + k] : NAN;
        if (isfinite(around)) {
            double free = compute_path_loss(scene, &pair, LOS);
            loss = around > free ? around : free;
            sigma = SOURCE_SIGMA_DB;
        }
        loss = loss + sigma * evaluate_field(scene->shadowing, scene->shadowing_waves, pair.from, pair.to);
    }
    if (pair.kind == NLOSV) loss = loss + compute_blockage(scene, &pair, is_known);
    return isfinite(pair.slopes) ? scene->sent_dbm - loss : NAN;
}

static bool is_scene_valid(const Array *arrays, bool has_corners) {
    static const int dimensions[ARRAYS] = {2, 1, 2, 2, 2, 2, 2};
    for (int i = 0; i < ARRAYS - !has_corners; i++)
        if (arrays[i].dimensions != dimensions[i]) return false;
    Py_ssize_t n = arrays[CLASSES].shape[0], total = arrays[CLASSES].shape[1];
    const unsigned char *classes = arrays[CLASSES].data;
    for (Py_ssize_t i = 0; i < arrays[CLASSES].count; i++)
        if (classes[i] > NLOSB) return false;
    for (int i = SHADOWING; i <= BLOCKAGE; i++)
        if (arrays[i].shape[0] < 1 || arrays[i].shape[1] != WAVE_NUMBERS) return false;
    return n <= total && arrays[XY].shape[0] == total && arrays[XY].shape[1] == 2 && arrays[HEIGHT].count == total &&
           arrays[BLOCKER].shape[0] == n && arrays[BLOCKER].shape[1] == total &&
           (!has_corners || (arrays[CORNER].shape[0] == n && arrays[CORNER].shape[1] == n));
}

static PyObject *receive_all(const Scene *scene) {
    double *power, *row = malloc((2 * scene->total + 1) * sizeof *row), *logarithms = row + scene->total;
    Py_ssize_t n = scene->n, total = scene->total;
    PyObject *result = row ? new_doubles(2, (Py_ssize_t[]){n, total}, &power) : PyErr_NoMemory();
    bool is_finite = true;
    for (Py_ssize_t i = 0; result && i < n; i++) {
        power[i * total + i] = scene->sent_dbm;
        for (Py_ssize_t k = i + 1; k < total; k++) row[k] = measure_distance(scene, i, k);
        portable_log_all(row + i + 1, logarithms + i + 1, (size_t)(total - i - 1));
        for (Py_ssize_t k = i + 1; k < total; k++) {
            double level = power[i * total + k] = receive(scene, i, k, logarithms[k]);
            if (k < n) power[k * total + i] = level;
            is_finite = is_finite && isfinite(level);
        }
    }
    free(row);
    if (!result || is_finite) return result;
    Py_DecRef(result);
    return refuse_numbers("compute_received_power");
}

static PyObject *v2x_radio_received_power_compute_received_power(PyObject *module, PyObject *const *arguments,
                                                                 Py_ssize_t given) {
    static const char types[ARRAYS] = {'d', 'd', 'B', 'd', 'd', 'd', 'd'};
    static const int places[ARRAYS] = {0, 1, 2, 3, 6, 7, 4};
    if (!expect_arguments("compute_received_power", given, 9, 9)) return NULL;
    bool has_corners = arguments[4] != &_Py_NoneStruct;
    Array arrays[ARRAYS], formulas;
    double sent_dbm;
    if (!read_number(arguments[8], &sent_dbm) || !open_doubles(arguments[5], 1, &formulas)) return NULL;
    int opened = 0, most = ARRAYS - !has_corners;
    while (opened < most && open_array(arguments[places[opened]], types[opened], arrays + opened)) opened++;
    PyObject *result = NULL;
    if (opened == most && formulas.count == 4 && is_scene_valid(arrays, has_corners)) {
        Scene scene = {doubles(arrays + XY), doubles(arrays + HEIGHT), doubles(arrays + BLOCKER),
                       has_corners ? doubles(arrays + CORNER) : NULL, arrays[CLASSES].data, doubles(arrays + SHADOWING),
                       doubles(arrays + BLOCKAGE), doubles(&formulas), arrays[SHADOWING].shape[0],
                       arrays[BLOCKAGE].shape[0], arrays[CLASSES].shape[0], arrays[CLASSES].shape[1], sent_dbm};
        result = receive_all(&scene);
    } else if (!PyErr_Occurred()) {
        PyErr_SetString(PyExc_ValueError, "expected the arrays of a radio scene, waves and formulas");
    }
    while (opened--) close_array(arrays + opened);
    close_array(&formulas);
    return result;
}

Functions v2x_radio_received_power = {
    FUNCTION(v2x_radio_received_power_compute_received_power),
    END_OF_FUNCTIONS,
};
