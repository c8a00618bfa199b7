/* Twins of movers.py. */
#include "movers.h"

#include <math.h>
#include <string.h>

static const double STANDSTILL_SPEED = 1e-3;
static Import MOVER = {"mdrive_sumo.actors.movers", "MOVER", 0};

double compute_safe_speed(double room, double speed, double brake) {
    double step = brake * TICK_S;
    double square = step * step + speed * speed + 2.0 * brake * (maximum(room, 0.0) + speed * TICK_S);
    return sqrt(square) - step;
}

static bool have_knots(const MoversOnPaths *open) {
    for (Py_ssize_t i = 0; i < open->count; i++)
        if (open->mover[i].first < 0 || open->mover[i].first >= open->mover[i].last ||
            open->mover[i].last >= open->knots.count)
            return false;
    return true;
}

bool open_movers_on_paths(PyObject *movers, PyObject *knots, MoversOnPaths *open) {
    if (!open_rows(movers, sizeof(Mover), &open->movers)) return false;
    open->mover = open->movers.data;
    open->count = open->movers.count;
    if (open_rows(knots, sizeof(Knot), &open->knots)) {
        open->knot = open->knots.data;
        if (have_knots(open)) return true;
        PyErr_SetString(PyExc_ValueError, "expected a path of two knots or more for each mover");
        close_array(&open->knots);
    }
    close_array(&open->movers);
    return false;
}

void close_movers_on_paths(MoversOnPaths *open) {
    close_array(&open->knots);
    close_array(&open->movers);
}

static PyObject *copy_movers(const Array *movers, Mover **copy) {
    void *data;
    PyObject *result = new_rows(&MOVER, movers->count, sizeof **copy, &data);
    if (!result) return NULL;
    *copy = data;
    if (movers->count) memcpy(data, movers->data, (size_t)movers->count * sizeof **copy);
    return result;
}

static bool find_present(const Mover *mover) {
    bool is_over = mover->progress > mover->end + LOG_TIME_TOLERANCE_S && !mover->stays_at_end;
    return mover->progress >= mover->begin - LOG_TIME_TOLERANCE_S && !is_over;
}

static void advance_mover(Mover *mover, double speed_limit) {
    bool is_timed = mover->is_timed;
    double room = is_timed ? INFINITY : maximum(mover->path_length - mover->s, 0.0);
    double limit = minimum(speed_limit, compute_safe_speed(room, 0.0, mover->comfort_brake));
    double planned = is_timed ? minimum(mover->slope, mover->script_speed) : mover->script_speed;
    double brake = mover->is_braking || is_timed ? mover->max_brake : mover->comfort_brake;
    double wanted = minimum(maximum(planned, mover->speed - brake * TICK_S), limit);
    double least = maximum(mover->speed - mover->max_brake * TICK_S, 0.0);
    double speed = clip(wanted, least, mover->speed + mover->accel * TICK_S);
    if (speed < STANDSTILL_SPEED) speed = 0.0;
    /* A log may exceed the kinematic limits. */
    if (is_timed && mover->clock_rate >= 1.0 && limit >= planned) speed = planned;
    if (mover->is_stopped) speed = 0.0;
    double clock_rate = planned > 1e-6 ? minimum(speed / maximum(planned, 1e-6), 1.0) : 1.0;
    if (mover->is_stopped) clock_rate = 0.0;
    double progress = mover->progress + (is_timed ? clock_rate : speed) * TICK_S;
    mover->speed = speed;
    mover->clock_rate = clock_rate;
    mover->progress = is_timed ? progress : minimum(progress, mover->end);
    mover->is_entering = find_present(mover) && !mover->is_present;
}

static PyObject *actors_movers_advance_movers(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Array movers, limits;
    if (!expect_arguments("advance_movers", count, 2, 2) || !open_rows(arguments[0], sizeof(Mover), &movers)) return NULL;
    PyObject *result = NULL;
    Mover *mover;
    if (open_doubles(arguments[1], 1, &limits)) {
        if (limits.count == movers.count) result = copy_movers(&movers, &mover);
        else PyErr_SetString(PyExc_ValueError, "expected a speed limit for each mover");
        for (Py_ssize_t i = 0; result && i < movers.count; i++) advance_mover(mover + i, doubles(&limits)[i]);
        close_array(&limits);
    }
    close_array(&movers);
    return result;
}

static void place_mover(Mover *mover, const Knot *knots, Py_ssize_t row) {
    double key = (double)row * ROW_STRIDE + mover->progress;
    int64_t first = mover->first, end = mover->last + 1;
    while (first < end) { /* the first knot with a greater key */
        int64_t middle = first + (end - first) / 2;
        if (knots[middle].progress_key <= key) first = middle + 1;
        else end = middle;
    }
    int64_t before = first - 1 < mover->first ? mover->first : first - 1;
    if (before > mover->last - 1 || key != key) before = mover->last - 1; /* NaN comes last in a search */
    const Knot *low = knots + before, *high = low + 1;
    double span = high->progress - low->progress, share = clip((mover->progress - low->progress) / span, 0.0, 1.0);
    mover->x = low->x + share * (high->x - low->x);
    mover->y = low->y + share * (high->y - low->y);
    mover->yaw = low->yaw + share * (high->yaw - low->yaw);
    mover->s = low->s + share * (high->s - low->s);
    mover->slope = mover->progress < mover->end ? (high->s - low->s) / span : 0.0;
    mover->is_present = find_present(mover);
}

static PyObject *actors_movers_place_movers(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    MoversOnPaths open;
    if (!expect_arguments("place_movers", count, 2, 2) || !open_movers_on_paths(arguments[0], arguments[1], &open))
        return NULL;
    Mover *mover;
    PyObject *result = copy_movers(&open.movers, &mover);
    for (Py_ssize_t i = 0; result && i < open.count; i++) place_mover(mover + i, open.knot, i);
    close_movers_on_paths(&open);
    return result;
}

Functions actors_movers = {
    FUNCTION(actors_movers_advance_movers),
    FUNCTION(actors_movers_place_movers),
    END_OF_FUNCTIONS,
};
