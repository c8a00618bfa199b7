/* Errors of detection_noise.py, of one object, for other C files. */
#include "detection_noise.h"

#include <math.h>

#include "../core/geometry.h"

enum { EPOCH_TICKS = 10 };

ErrorDraws start_errors(int64_t seed) {
    Purpose start = start_purpose(seed);
    ErrorDraws draws = {start, start, start};
    add_text(&draws.phase, "phase", 5);
    add_text(&draws.miss, "miss", 4);
    add_text(&draws.error, "error", 5);
    return draws;
}

bool find_epoch(const ErrorDraws *draws, PyObject *id, int64_t tick, EpochTime *time) {
    Purpose purpose = draws->phase;
    if (!add_object(&purpose, id)) return false;
    int64_t due = tick + (int64_t)(draw_first_uniform(&purpose) * EPOCH_TICKS);
    time->step = (due % EPOCH_TICKS + EPOCH_TICKS) % EPOCH_TICKS;
    time->epoch = (due - time->step) / EPOCH_TICKS;
    return true;
}

bool draw_detected(const ErrorDraws *draws, PyObject *id, EpochTime time, double recall, bool *is_detected) {
    Purpose purpose = draws->miss;
    if (!add_object(&purpose, id)) return false;
    add_number(&purpose, time.epoch);
    *is_detected = draw_first_uniform(&purpose) < recall;
    return true;
}

/* As _interpolate_errors, of one object. */
static bool interpolate_errors(const ErrorDraws *draws, PyObject *id, EpochTime time, double errors[UNIFORMS]) {
    Purpose earlier = draws->error;
    if (!add_object(&earlier, id)) return false;
    Purpose later = earlier;
    add_number(&earlier, time.epoch);
    add_number(&later, time.epoch + 1);
    double before[UNIFORMS], after[UNIFORMS];
    draw_normals(&earlier, before);
    draw_normals(&later, after);
    CosSin weights = cos_sin(PI / 2 * (double)time.step / EPOCH_TICKS);
    for (int i = 0; i < UNIFORMS; i++) errors[i] = weights.cos * before[i] + weights.sin * after[i];
    return true;
}

bool add_errors(const DetectionProfile *profile, const ErrorDraws *draws, EpochTime time, Eye eye, Detection *seen) {
    double noise[UNIFORMS], *columns = seen->columns;
    if (!interpolate_errors(draws, seen->id, time, noise)) return false;
    double x = columns[0] - eye.x, y = columns[1] - eye.y;
    double spread = compute_spread_at(profile, portable_hypot(x, y));
    CosSin towards = cos_sin(portable_atan2(y, x));
    double along = spread * noise[0], across = spread * noise[1];
    double scale[] = {portable_exp(profile->size_sigma * noise[4]), portable_exp(profile->size_sigma * noise[5])};
    if (isnan(towards.cos) || !isfinite(scale[0]) || !isfinite(scale[1])) {
        PyErr_SetString(PyExc_ValueError, "expected finite places and errors of detections");
        return false;
    }
    columns[0] = columns[0] + along * towards.cos - across * towards.sin;
    columns[1] = columns[1] + along * towards.sin + across * towards.cos;
    columns[2] = wrap_half_open(columns[2] + profile->yaw_sigma * noise[2]);
    columns[3] = columns[3] + profile->speed_sigma * noise[3];
    columns[4] = columns[4] * scale[0];
    columns[5] = columns[5] * scale[1];
    return true;
}
