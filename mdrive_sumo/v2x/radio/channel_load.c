/* Twins of channel_load.py: for each sender and receiver, one interferer after another. */
#include <stdlib.h>

#include "../../core/compiled/values.h"
#include "../../core/portable.h"
#include "link_class.h"
#include "packet_error.h"

static const double PER_LN10 = 0.43429448190325182765, SLOT_S = 13e-6, SUBFRAME_S = 1e-3, PERIOD_S = 0.1, TAU_PACKETS = 10.0;
enum { SUBCHANNELS = 5 };

enum { POWER, CLASSES, KNOWN, RATE, SIZE, BLURRED, ARRAYS };
/* Results: the busy ratio, and risks (n, n). */
enum { BUSY_RATIO, COLLISION_PER_PACKET, COLLISION_PER_SECOND, BUSY, HALF_DUPLEX_PER_PACKET, HALF_DUPLEX_PER_SECOND, RESULTS };

typedef struct {
    Py_ssize_t n, total;
    const double *power, *rate, *size;
    const unsigned char *classes, *known;
    ErrorCurves curves;
    double noise_dbm, sensing_dbm;
    /* (n, total) each: whether a station notices a sender, which share of what it notices the other notices, level of
       noise and sender [dBm], and, as the model needs them, what an interferer may do while a station sends, without
       and with having heard it. */
    double *detected, *overlap, *disturbed, *hidden, *heard;
    double *results[RESULTS];
} Load;

static const double PER_DB = 0.1 / PER_LN10;

/* What follows from each level alone; false where one is no number. `work`: (n, total). */
static bool compute_each(Load *load, double *restrict work) {
    static const double shadowing_db[] = {3.0, 3.0, 4.0};
    size_t size = (size_t)(load->n * load->total);
    double noise = portable_exp(load->noise_dbm * PER_DB), *overlap = load->overlap, *detected = load->detected;
    for (size_t i = 0; i < size; i++) work[i] = load->power[i] * PER_DB;
    portable_exp_all(work, load->disturbed, size);
    for (size_t i = 0; i < size; i++) work[i] = noise + load->disturbed[i];
    portable_log_all(work, load->disturbed, size);
    for (size_t i = 0; i < size; i++) {
        load->disturbed[i] = 10.0 * (load->disturbed[i] * PER_LN10);
        double margin = load->power[i] - load->sensing_dbm;
        margin = margin < -60.0 ? -60.0 : margin > 60.0 ? 60.0 : margin;
        work[i] = -0.5 * margin * PER_DB;
    }
    portable_exp_all(work, overlap, size);
    for (size_t i = 0; i < size; i++) {
        if (!isfinite(load->disturbed[i])) return false;
        overlap[i] = 1.0 - 0.5 * overlap[i] > 0.0 ? 1.0 - 0.5 * overlap[i] : 0.0;
        double distance = fabs((load->power[i] - load->sensing_dbm) / shadowing_db[load->classes[i]]);
        work[i] = -0.5 * distance * distance;
    }
    portable_exp_all(work, detected, size);
    for (Py_ssize_t i = 0; i < load->n; i++)
        for (Py_ssize_t k = 0; k < load->total; k++) {
            Py_ssize_t place = i * load->total + k;
            double margin = load->power[place] - load->sensing_dbm, x = margin / shadowing_db[load->classes[place]];
            double t = 1.0 / (1.0 + 0.2316419 * fabs(x)); /* the normal distribution, as compute_normal_cdf */
            double series = 1.781477937 + t * (-1.821255978 + t * 1.330274429);
            series = t * (0.319381530 + t * (-0.356563782 + t * series));
            double tail = detected[place] * 0.3989422804014327 * series;
            double chance = x < 0.0 ? tail : 1.0 - tail, certain = margin >= 0.0 ? 1.0 : 0.0;
            detected[place] = i == k ? 0.0 : load->known[k] ? certain : chance;
        }
    return true;
}

static double compress_load(double offered) {
    double load = offered < 1.84 ? offered : 1.84;
    double fitted = (-0.2481 * load + 0.913) * load + 0.003844, least = fitted < load ? fitted : load;
    return least < 0.84 ? least : 0.84;
}

static double spread_reservations(double offered) {
    double half = (offered < 2.0 ? offered : 2.0) / 2.0, one_by_one = half < 0.5 ? half : 0.5;
    double below = 2.0 * one_by_one - one_by_one * one_by_one / (2.0 * (1.0 - one_by_one));
    double share = half <= 0.5 ? below : 0.5 + half / 2.0;
    return share < 0.95 ? share : 0.95;
}

/* A packet at station k that a sender's signal brings. */
typedef struct {
    double signal, alone, intact;
    unsigned char kind;
} Packet;

static Packet open_packet(const Load *load, Py_ssize_t sender, Py_ssize_t k) {
    Packet packet = {load->power[k * load->total + sender], 0.0, 0.0, load->classes[k * load->total + sender]};
    packet.alone = interpolate_curve(&load->curves, packet.signal - load->noise_dbm, packet.kind);
    packet.intact = 1.0 - packet.alone > 1e-9 ? 1.0 - packet.alone : 1e-9;
    return packet;
}

static double compute_spoiling(const Load *load, const Packet *packet, double disturbed) {
    if (!(packet->alone < 1.0)) return 0.0;
    double lost = interpolate_curve(&load->curves, packet->signal - disturbed, packet->kind) - packet->alone;
    return (lost > 0.0 ? lost : 0.0) / packet->intact;
}

static void sum_itsg5(const Load *load, Py_ssize_t i, Py_ssize_t k) {
    Packet packet = open_packet(load, i, k);
    const double *detected = load->detected + k * load->total, *disturbed = load->disturbed + k * load->total;
    double per_packet = 0.0, per_second = 0.0, busy = 0.0;
    for (Py_ssize_t j = 0; j < load->total; j++) {
        if (j == i || j == k) continue;
        double hidden = load->hidden[i * load->total + j], heard = load->heard[i * load->total + j];
        if (hidden == 0.0 && heard == 0.0) continue;
        double spoils = compute_spoiling(load, &packet, disturbed[j]);
        bool is_nearer = load->power[k * load->total + j] > packet.signal;
        double late = (is_nearer ? 0.0 : heard) * spoils, deaf = hidden * spoils;
        double taken = hidden * detected[j] * load->size[j];
        per_packet += late + deaf * (1.0 - detected[j]) * load->size[j];
        per_second += deaf;
        busy += taken + (is_nearer ? heard * detected[j] : 0.0);
    }
    Py_ssize_t place = i * load->n + k;
    load->results[COLLISION_PER_PACKET][place] = per_packet;
    load->results[COLLISION_PER_SECOND][place] = per_second;
    load->results[BUSY][place] = busy;
    double heard = load->heard[i * load->total + k], hidden = load->hidden[i * load->total + k];
    load->results[HALF_DUPLEX_PER_PACKET][place] = heard + hidden * load->size[k];
    load->results[HALF_DUPLEX_PER_SECOND][place] = hidden;
}

static void sum_sidelink(const Load *load, Py_ssize_t i, Py_ssize_t k) {
    Packet packet = open_packet(load, i, k);
    double risk = 0.0;
    for (Py_ssize_t j = 0; j < load->total; j++)
        if (j != i && j != k)
            risk += load->hidden[i * load->total + j] *
                    compute_spoiling(load, &packet, load->disturbed[k * load->total + j]);
    load->results[COLLISION_PER_PACKET][i * load->n + k] = risk;
    load->results[HALF_DUPLEX_PER_PACKET][i * load->n + k] = load->rate[k] * SUBFRAME_S;
}

static void prepare_itsg5(Load *load, Py_ssize_t i) {
    double offered = 0.0;
    const double *detected = load->detected + i * load->total;
    for (Py_ssize_t k = 0; k < load->total; k++) offered += detected[k] * (load->rate[k] * load->size[k]);
    double busy = load->results[BUSY_RATIO][i] = compress_load(offered);
    for (Py_ssize_t k = 0; k < load->total; k++) {
        Py_ssize_t place = i * load->total + k;
        double chance = load->rate[k] / (1.0 - busy * load->overlap[place]);
        load->hidden[place] = chance * (1.0 - detected[k]);
        load->heard[place] = chance * detected[k] * SLOT_S;
    }
}

static void prepare_sidelink(Load *load, Py_ssize_t i) {
    double offered = 0.0, resources = SUBCHANNELS * PERIOD_S / SUBFRAME_S;
    const double *detected = load->detected + i * load->total;
    for (Py_ssize_t k = 0; k < load->total; k++)
        offered += detected[k] * (load->rate[k] * PERIOD_S * load->size[k] / resources);
    double busy = load->results[BUSY_RATIO][i] = spread_reservations(offered);
    for (Py_ssize_t k = 0; k < load->total; k++) {
        Py_ssize_t place = i * load->total + k;
        double common = 1.0 - 2.0 * busy + load->overlap[place] * (busy - busy * busy) + busy * busy;
        double unheard = 1.0 - (1.0 - 1.0 / TAU_PACKETS) * detected[k];
        double taken = load->rate[k] * PERIOD_S * load->size[k] / resources;
        load->hidden[place] = unheard * common / ((1.0 - busy) * (1.0 - busy)) * taken;
    }
}

typedef struct {
    const char *name;
    void (*prepare)(Load *load, Py_ssize_t i);
    void (*sum)(const Load *load, Py_ssize_t i, Py_ssize_t k);
} Model;

static PyObject *compute_load(const Model *model, Load *load) {
    Py_ssize_t n = load->n, size = n * load->total;
    double *work = malloc((6 * size + 1) * sizeof *work);
    if (!work) return PyErr_NoMemory();
    double **parts[] = {&load->detected, &load->overlap, &load->disturbed, &load->hidden, &load->heard};
    for (int i = 0; i < 5; i++) *parts[i] = work + (i + 1) * size;
    PyObject *arrays[RESULTS] = {0};
    bool is_made = true;
    for (int r = 0; is_made && r < RESULTS; r++) {
        Py_ssize_t shape[] = {n, n};
        is_made = (arrays[r] = new_doubles(r == BUSY_RATIO ? 1 : 2, shape, load->results + r));
        for (Py_ssize_t i = 0; is_made && i < (r == BUSY_RATIO ? n : n * n); i++) load->results[r][i] = 0.0;
    }
    if (is_made && !compute_each(load, work)) {
        refuse_numbers(model->name);
        is_made = false;
    }
    for (Py_ssize_t i = 0; is_made && i < n; i++) model->prepare(load, i);
    for (Py_ssize_t i = 0; is_made && i < n; i++)
        for (Py_ssize_t k = 0; k < n; k++)
            if (i != k) model->sum(load, i, k);
    free(work);
    if (is_made) return pack(RESULTS, arrays[0], arrays[1], arrays[2], arrays[3], arrays[4], arrays[5]);
    for (int r = 0; r < RESULTS; r++)
        if (arrays[r]) Py_DecRef(arrays[r]);
    return NULL;
}

static bool are_valid(const Array *arrays) {
    static const int dimensions[ARRAYS] = {2, 2, 1, 1, 1, 2};
    for (int i = 0; i < ARRAYS; i++)
        if (arrays[i].dimensions != dimensions[i]) return false;
    Py_ssize_t n = arrays[POWER].shape[0], total = arrays[POWER].shape[1];
    const unsigned char *classes = arrays[CLASSES].data;
    for (Py_ssize_t i = 0; i < arrays[CLASSES].count; i++)
        if (classes[i] > NLOSB) return false;
    return n <= total && arrays[CLASSES].shape[0] == n && arrays[CLASSES].shape[1] == total &&
           arrays[KNOWN].count == total && arrays[RATE].count == total && arrays[SIZE].count == total &&
           arrays[BLURRED].shape[0] == CURVES && arrays[BLURRED].shape[1] > 1 && arrays[BLURRED].shape[1] < 1000;
}

static PyObject *sum_risks(const Model *model, PyObject *const *arguments, Py_ssize_t given) {
    static const char types[ARRAYS] = {'d', 'B', '?', 'd', 'd', 'd'};
    double levels[3]; /* first of the curves, noise, sensing */
    if (!expect_arguments(model->name, given, 9, 9) || !read_numbers(arguments + 6, 3, levels)) return NULL;
    Array arrays[ARRAYS];
    int opened = 0;
    while (opened < ARRAYS && open_array(arguments[opened], types[opened], arrays + opened)) opened++;
    PyObject *result = NULL;
    if (opened == ARRAYS && are_valid(arrays)) {
        Load load = {.n = arrays[POWER].shape[0], .total = arrays[POWER].shape[1], .power = doubles(arrays + POWER),
                     .rate = doubles(arrays + RATE), .size = doubles(arrays + SIZE), .classes = arrays[CLASSES].data,
                     .known = arrays[KNOWN].data, .noise_dbm = levels[1], .sensing_dbm = levels[2],
                     .curves = {doubles(arrays + BLURRED), (int)arrays[BLURRED].shape[1], levels[0]}};
        result = compute_load(model, &load);
    } else if (!PyErr_Occurred()) {
        PyErr_SetString(PyExc_ValueError, "expected what stations hear and send, and error curves");
    }
    while (opened--) close_array(arrays + opened);
    return result;
}

static PyObject *v2x_radio_channel_load_sum_itsg5_risks(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
    static const Model model = {"sum_itsg5_risks", prepare_itsg5, sum_itsg5};
    return sum_risks(&model, arguments, given);
}

static PyObject *v2x_radio_channel_load_sum_sidelink_risks(PyObject *module, PyObject *const *arguments,
                                                           Py_ssize_t given) {
    static const Model model = {"sum_sidelink_risks", prepare_sidelink, sum_sidelink};
    return sum_risks(&model, arguments, given);
}

Functions v2x_radio_channel_load = {
    FUNCTION(v2x_radio_channel_load_sum_itsg5_risks),
    FUNCTION(v2x_radio_channel_load_sum_sidelink_risks),
    END_OF_FUNCTIONS,
};
