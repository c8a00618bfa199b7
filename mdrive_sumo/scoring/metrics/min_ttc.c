/* Twin of min_ttc.py. */
#include "frames.h"

static const double HORIZON_S = 1.8, MIN_CLOSING_SPEED = 1.0;

static bool may_touch(Point apart, Point drift, double reach) {
    double distance = portable_hypot(apart.x, apart.y), closing = -(apart.x * drift.x + apart.y * drift.y);
    return closing >= MIN_CLOSING_SPEED * distance &&
           distance - reach <= HORIZON_S * portable_hypot(drift.x, drift.y);
}

/* When boxes touch of which the second one drifts: INFINITY if never. */
static double compute_contact_time(const Box *own, const Box *other, Point drift) {
    double enter = 0.0, leave = INFINITY;
    for (int i = 0; i < 4; i++) {
        const Point *corner = (i < 2 ? own : other)->corner, *end = corner + (i % 2 ? 3 : 1);
        double x = end->x - corner->x, y = end->y - corner->y, a_low, a_high, b_low, b_high;
        project_box(own, x, y, &a_low, &a_high);
        project_box(other, x, y, &b_low, &b_high);
        double low = a_low - b_high, high = a_high - b_low, speed = drift.x * x + drift.y * y;
        if (fabs(speed) > 1e-9) {
            double one = low / speed, two = high / speed;
            enter = greatest(enter, least(one, two)), leave = least(leave, greatest(one, two));
        } else if (!(low <= 0.0 && high >= 0.0)) {
            return INFINITY;
        }
    }
    return enter <= leave ? enter : INFINITY;
}

static Point get_velocity(const Frames *frames, Py_ssize_t cell, bool *is_refused) {
    CosSin ahead = cos_sin(doubles(&frames->yaw)[cell]);
    if (!isfinite(ahead.cos)) *is_refused = true;
    return (Point){ahead.cos * doubles(&frames->speed)[cell], ahead.sin * doubles(&frames->speed)[cell]};
}

static double find_least_time(const Frames *frames, Py_ssize_t column, bool *is_refused) {
    double least_time = INFINITY, radius = get_radius(frames, column);
    const double *x = doubles(&frames->x), *y = doubles(&frames->y);
    for (Py_ssize_t tick = 0; tick < frames->frames; tick++) {
        if (!is_valid(frames, tick, column)) continue;
        Py_ssize_t own = tick * frames->columns + column;
        Point velocity = get_velocity(frames, own, is_refused);
        Box box = get_box(frames, tick, column);
        for (Py_ssize_t i = column + 1; i < frames->columns; i++) {
            if (!is_valid(frames, tick, i)) continue;
            Py_ssize_t cell = tick * frames->columns + i;
            Point theirs = get_velocity(frames, cell, is_refused), apart = {x[cell] - x[own], y[cell] - y[own]};
            Point drift = {theirs.x - velocity.x, theirs.y - velocity.y};
            if (!may_touch(apart, drift, get_radius(frames, i) + radius)) continue;
            Box other = get_box(frames, tick, i);
            least_time = least(compute_contact_time(&box, &other, drift), least_time);
        }
    }
    return least_time;
}

static PyObject *scoring_metrics_min_ttc__find_least_time(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Frames frames;
    Py_ssize_t column;
    if (!expect_arguments("_find_least_time", count, 8, 8) || !open_frames(arguments, true, &frames, &column)) return NULL;
    bool is_refused = false;
    double time = find_least_time(&frames, column, &is_refused) + 0.0;
    close_frames(&frames);
    if (is_refused) return refuse_numbers("_find_least_time");
    return time <= HORIZON_S ? PyFloat_FromDouble(time) : new_reference(Py_None);
}

Functions scoring_metrics_min_ttc = {
    FUNCTION(scoring_metrics_min_ttc__find_least_time),
    END_OF_FUNCTIONS,
};
