/* Twins of track_states.py. */
#include "track_states.h"

#include <string.h>

#include "../core/geometry.h"
#include "measurements.h"
#include "tracking_parameters.h"

static const double MAX_YAW_STEP = 0.5;
static Import TRACK = {"mdrive_sumo.perception.track_states", "TRACK", 0};

bool open_tracks(PyObject *object, Array *tracks) { return open_rows(object, sizeof(Track), tracks); }

PyObject *copy_tracks(const Track *tracks, Py_ssize_t count, Track **copy) {
    void *data;
    PyObject *result = new_rows(&TRACK, count, sizeof *tracks, &data);
    if (!result) return NULL;
    *copy = data;
    if (count) memcpy(data, tracks, (size_t)count * sizeof *tracks);
    return result;
}

bool open_indices(PyObject *object, Py_ssize_t limit, Array *indices) {
    if (!open_array(object, 'l', indices)) return false;
    for (Py_ssize_t i = 0; i < indices->count; i++)
        if (integers(indices)[i] < 0 || integers(indices)[i] >= limit) {
            PyErr_Format(PyExc_ValueError, "expected rows below %zd, found row %lld", limit,
                         (long long)integers(indices)[i]);
            close_array(indices);
            return false;
        }
    return true;
}

static Track start_track(Py_ssize_t tick, Py_ssize_t number, const Measurement *new, bool is_own, bool is_confirmed,
                         const TrackingParameters *parameters) {
    double turn_rate_sigma = parameters->max_turn_rate / 2;
    return (Track){.x = new->x,
                   .y = new->y,
                   .vx = new->vx,
                   .vy = new->vy,
                   .position = new->position + new->bias,
                   .velocity = new->speed_variance,
                   .yaw = new->yaw,
                   .yaw_variance = new->yaw_variance,
                   .turn_variance = turn_rate_sigma * turn_rate_sigma,
                   .length = new->length,
                   .width = new->width,
                   .number = number,
                   .kind = new->kind,
                   .born_tick = tick,
                   .seen_tick = tick,
                   .confirmed = is_confirmed,
                   .seen_by_sensor = is_own,
                   .mean_x = new->x,
                   .mean_y = new->y,
                   .mean_vx = new->vx,
                   .mean_vy = new->vy,
                   .mean_count = 1,
                   .mean_tick = tick};
}

static PyObject *perception_track_states_start_tracks(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    TrackingParameters parameters;
    Array tracks;
    OpenMeasurements new;
    Py_ssize_t tick, number;
    if (!expect_arguments("start_tracks", count, 6, 6) || !read_integer(arguments[1], &tick) ||
        !read_integer(arguments[2], &number) || !read_tracking_parameters(arguments[5], &parameters) ||
        !open_tracks(arguments[0], &tracks))
        return NULL;
    PyObject *result = NULL;
    if (open_measurements(arguments[3], &new)) {
        void *data;
        bool is_confirmed = PyObject_IsTrue(arguments[4]) == 1;
        result = new_rows(&TRACK, tracks.count + new.count, sizeof(Track), &data);
        if (result && tracks.count) memcpy(data, tracks.data, (size_t)tracks.count * sizeof(Track));
        for (Py_ssize_t i = 0; result && i < new.count; i++)
            ((Track *)data)[tracks.count + i] =
                start_track(tick, number + i, new.row + i, new.is_own, is_confirmed, &parameters);
        close_measurements(&new);
    }
    close_array(&tracks);
    return result;
}

static void grow(double *first, double *both, double *second, double seconds, double sigma) {
    double noise = sigma * sigma, square = seconds * seconds;
    *first = *first + seconds * (2 * *both + seconds * *second) + noise * square * square / 4;
    *both = *both + seconds * *second + noise * square * seconds / 2;
    *second = *second + noise * square;
}

/* Whether the turn is finite. */
static bool predict_track(Track *track, double seconds, const TrackingParameters *parameters) {
    bool moves = portable_hypot(track->vx, track->vy) > parameters->moving_speed;
    double turn = (moves ? track->turn_rate : 0.0) * seconds;
    CosSin half = cos_sin(turn / 2);
    double vx = half.cos * track->vx - half.sin * track->vy, vy = half.sin * track->vx + half.cos * track->vy;
    track->x = track->x + vx * seconds;
    track->y = track->y + vy * seconds;
    track->vx = half.cos * vx - half.sin * vy;
    track->vy = half.sin * vx + half.cos * vy;
    track->yaw = wrap_half_open(track->yaw + turn);
    grow(&track->position, &track->coupling, &track->velocity, seconds, parameters->acceleration_sigma);
    grow(&track->yaw_variance, &track->yaw_coupling, &track->turn_variance, seconds,
         parameters->turn_acceleration_sigma);
    track->seen_by_sensor = 0;
    return isfinite(half.cos);
}

static PyObject *perception_track_states_predict(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double seconds;
    TrackingParameters parameters;
    Array tracks;
    if (!expect_arguments("predict", count, 3, 3) || !read_number(arguments[1], &seconds) ||
        !read_tracking_parameters(arguments[2], &parameters) || !open_tracks(arguments[0], &tracks))
        return NULL;
    Track *track;
    PyObject *result = copy_tracks(tracks.data, tracks.count, &track);
    for (Py_ssize_t i = 0; result && i < tracks.count; i++)
        if (!predict_track(track + i, seconds, &parameters)) {
            Py_DecRef(result);
            result = NULL;
            PyErr_SetString(PyExc_ValueError, "expected tracks with finite turn rates, found NaN or infinity");
        }
    close_array(&tracks);
    return result;
}

static const Measurement *get_measurement(const Measurement *rows, const int64_t *columns, Py_ssize_t i) {
    return rows + columns[i];
}

/* The mean of the measurements columns[0] to columns[count - 1], as _average; sums begin with 0.0 as bincount's. */
static Measurement average(const Measurement *rows, const int64_t *columns, Py_ssize_t count) {
    Measurement mean = *get_measurement(rows, columns, 0);
    double place_sum = 0.0, speed_sum = 0.0, yaw_sum = 0.0, position_sum = 0.0;
    double x = 0.0, y = 0.0, bias = 0.0, length = 0.0, width = 0.0, vx = 0.0, vy = 0.0, yaw = 0.0;
    for (Py_ssize_t i = 0; i < count; i++) {
        const Measurement *one = get_measurement(rows, columns, i);
        double place = 1 / (one->position + one->bias), speed = 1 / one->speed_variance, turn = 1 / one->yaw_variance;
        place_sum += place, speed_sum += speed, yaw_sum += turn, position_sum += 1 / one->position;
        x += one->x * place, y += one->y * place, bias += one->bias * place;
        length += one->length * place, width += one->width * place;
        vx += one->vx * speed, vy += one->vy * speed;
        yaw += wrap_half_open(one->yaw - mean.yaw) * turn;
    }
    mean.x = x / place_sum, mean.y = y / place_sum, mean.bias = bias / place_sum;
    mean.length = length / place_sum, mean.width = width / place_sum;
    mean.vx = vx / speed_sum, mean.vy = vy / speed_sum;
    mean.yaw += yaw / yaw_sum;
    mean.position = 1 / position_sum, mean.yaw_variance = 1 / yaw_sum, mean.speed_variance = 1 / speed_sum;
    return mean;
}

static void correct_position(Track *track, const Measurement *new) {
    double beyond = track->position - new->bias, excess = beyond < 0.0 ? 0.0 : beyond; /* NaN stays NaN */
    double coupling = track->coupling * sqrt(excess / track->position), total = excess + new->position;
    double gain = excess / total, velocity_gain = coupling / total;
    double dx = new->x - track->x, dy = new->y - track->y;
    track->x += gain * dx;
    track->y += gain * dy;
    track->vx += velocity_gain * dx;
    track->vy += velocity_gain * dy;
    track->position -= gain * excess;
    track->coupling *= 1.0 - gain;
    track->velocity -= velocity_gain * coupling;
}

static void correct_velocity(Track *track, const Measurement *new) {
    double total = track->velocity + new->speed_variance;
    double gain = track->velocity / total, position_gain = track->coupling / total;
    double dvx = new->vx - track->vx, dvy = new->vy - track->vy;
    track->x += position_gain * dvx;
    track->y += position_gain * dvy;
    track->vx += gain * dvx;
    track->vy += gain * dvy;
    track->position -= position_gain * track->coupling;
    track->coupling *= 1.0 - gain;
    track->velocity *= 1.0 - gain;
}

static double clip(double value, double low, double high) { return value < low ? low : value > high ? high : value; }

static void correct_yaw(Track *track, const Measurement *new, const TrackingParameters *parameters) {
    double step = wrap_half_open(new->yaw - track->yaw);
    bool anew = fabs(step) > MAX_YAW_STEP;
    double coupling = track->yaw_coupling, total = track->yaw_variance + new->yaw_variance;
    double gain = anew ? 1.0 : track->yaw_variance / total, turn_gain = anew ? 0.0 : coupling / total;
    track->yaw = wrap_half_open(track->yaw + gain * step);
    double turn = anew ? 0.0 : track->turn_rate + turn_gain * step;
    track->turn_rate = clip(turn, -parameters->max_turn_rate, parameters->max_turn_rate);
    track->turn_variance -= turn_gain * coupling;
    track->yaw_variance = anew ? new->yaw_variance : track->yaw_variance * (1.0 - gain);
    track->yaw_coupling = anew ? 0.0 : coupling * (1.0 - gain);
}

static void correct_track(Track *track, const Measurement *new, const TrackingParameters *parameters) {
    correct_position(track, new);
    correct_velocity(track, new);
    correct_yaw(track, new, parameters);
    track->length += (new->length - track->length) / parameters->size_weight;
    track->width += (new->width - track->width) / parameters->size_weight;
}

/* All with means as soon as one track has several measurements: the mean of one may differ from it in the last digit. */
void correct_tracks(Track *tracks, const int64_t *rows, const Measurement *new, const int64_t *columns,
                           Py_ssize_t count, const TrackingParameters *parameters) {
    bool has_means = false;
    for (Py_ssize_t i = 1; i < count; i++) has_means |= rows[i] == rows[i - 1];
    for (Py_ssize_t i = 0, end; i < count; i = end) {
        for (end = i + 1; end < count && rows[end] == rows[i];) end++;
        Measurement one = has_means ? average(new, columns + i, end - i) : *get_measurement(new, columns, i);
        correct_track(tracks + rows[i], &one, parameters);
    }
}

Functions perception_track_states = {
    FUNCTION(perception_track_states_start_tracks),
    FUNCTION(perception_track_states_predict),
    END_OF_FUNCTIONS,
};
