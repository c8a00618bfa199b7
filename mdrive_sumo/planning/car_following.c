/* Twin of car_following.py. */
#include <stdlib.h>

#include "path_overlap.h"

FIELDS(PARAMETERS, "deceleration", "hardest_deceleration", "reaction_s", "min_gap_m", "max_acceleration", "speeding_up",
       "stopping", "step_s");
enum { DECELERATION, HARDEST, REACTION_S, MIN_GAP_M, MAX_ACCELERATION, SPEEDING_UP, STOPPING, STEP_S, NUMBERS };
FIELDS(AHEAD, "row", "gap_m");
static Import FOLLOWING = {"mdrive_sumo.planning.car_following", "FOLLOWING", 0};
static Import TRAVEL = {"mdrive_sumo.planning.car_following", "Travel", 0};

/* As NumPy's: NaN stays NaN. */
static double maximum(double a, double b) { return a > b || a != a ? a : b; }
static double minimum(double a, double b) { return a < b || a != a ? a : b; }

typedef struct {
    Array speed, acceleration, row, gap_m, times;
    double numbers[NUMBERS], top_speed;
    Py_ssize_t count, steps;
    double *distance, *speeds, *trend, *highest; /* (steps + 1, count) twice, (count,) twice */
} Following;

static void begin(Following *all) {
    const double *p = all->numbers;
    for (Py_ssize_t i = 0; i < all->count; i++) {
        double a = doubles(&all->acceleration)[i], clipped = a < -9.0 ? -9.0 : a > p[MAX_ACCELERATION] ? p[MAX_ACCELERATION] : a;
        all->trend[i] = a > p[SPEEDING_UP] || a < p[STOPPING] ? clipped : 0.0;
        all->distance[i] = 0.0, all->speeds[i] = maximum(doubles(&all->speed)[i], 0.0);
        all->highest[i] = maximum(all->top_speed, all->speeds[i]);
    }
}

/* The speed of a vehicle a step later. */
static double follow(const Following *all, const double *distance, const double *speeds, Py_ssize_t i) {
    const double *p = all->numbers;
    double step_s = p[STEP_S], now = speeds[i], wanted = now + all->trend[i] * step_s, safe = INFINITY;
    wanted = wanted < 0.0 ? 0.0 : wanted > all->highest[i] ? all->highest[i] : wanted;
    Py_ssize_t leader = (Py_ssize_t)integers(&all->row)[i];
    if (leader >= 0) {
        double gap = doubles(&all->gap_m)[i] - p[MIN_GAP_M] + distance[leader] - distance[i], room = maximum(gap, 0.0);
        double expected = p[DECELERATION] * p[REACTION_S], lead = speeds[leader];
        safe = sqrt(expected * expected + lead * lead + 2 * p[DECELERATION] * room) - expected;
    }
    return minimum(wanted, maximum(safe, maximum(now - p[HARDEST] * step_s, 0.0)));
}

static void drive(Following *all) {
    Py_ssize_t count = all->count;
    for (Py_ssize_t step = 0; step < all->steps; step++) {
        const double *distance = all->distance + step * count, *speeds = all->speeds + step * count;
        for (Py_ssize_t i = 0; i < count; i++) {
            double after = follow(all, distance, speeds, i);
            all->speeds[(step + 1) * count + i] = after;
            all->distance[(step + 1) * count + i] = distance[i] + (speeds[i] + after) / 2 * all->numbers[STEP_S];
        }
    }
}

/* Rows (T, count) of values (steps + 1, count) at times. */
static PyObject *sample(const Following *all, const double *values) {
    Py_ssize_t count = all->count;
    double *sampled;
    PyObject *array = new_doubles(2, (Py_ssize_t[]){all->times.count, count}, &sampled);
    for (Py_ssize_t row = 0; array && row < all->times.count; row++) {
        double at = doubles(&all->times)[row] / all->numbers[STEP_S];
        Py_ssize_t low = at > 0.0 ? at < (double)(all->steps - 1) ? (Py_ssize_t)at : all->steps - 1 : 0;
        double share = at - (double)low;
        const double *before = values + low * count;
        for (Py_ssize_t i = 0; i < count; i++)
            sampled[row * count + i] = before[i] * (1 - share) + before[count + i] * share;
    }
    return array;
}

static bool count_steps(Following *all) {
    double last_s = 0.0;
    for (Py_ssize_t row = 0; row < all->times.count; row++) last_s = maximum(doubles(&all->times)[row], last_s);
    double steps = ceil(last_s / all->numbers[STEP_S]) + 1;
    bool are_valid = steps >= 1.0 && steps < 1e6 && all->acceleration.count == all->count && all->row.count == all->count &&
                     all->gap_m.count == all->count;
    for (Py_ssize_t i = 0; are_valid && i < all->count; i++) are_valid = integers(&all->row)[i] < all->count;
    all->steps = are_valid ? (Py_ssize_t)steps : 0;
    if (!are_valid) PyErr_SetString(PyExc_ValueError, "expected finite times, and leaders among the vehicles");
    return are_valid;
}

static PyObject *predict(Following *all) {
    all->count = all->speed.count;
    PyObject *class = find_import(&TRAVEL), *result = NULL;
    if (!class || !count_steps(all)) return NULL;
    size_t states = (size_t)(all->steps + 1) * (size_t)all->count;
    double *memory = malloc((2 * states + 2 * (size_t)all->count + 1) * sizeof *memory);
    if (!memory) return PyErr_NoMemory();
    all->distance = memory, all->speeds = memory + states, all->trend = memory + 2 * states;
    all->highest = all->trend + all->count;
    begin(all);
    drive(all);
    PyObject *distance = sample(all, all->distance), *speed = distance ? sample(all, all->speeds) : NULL;
    if (speed) result = PyObject_CallFunctionObjArgs(class, distance, speed, NULL);
    if (distance) Py_DecRef(distance);
    if (speed) Py_DecRef(speed);
    free(memory);
    return result;
}

static PyObject *planning_car_following_predict_travel(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Following all = {0};
    if (!expect_arguments("predict_travel", count, 5, 6)) return NULL;
    PyObject *parameters = count > 5 ? arguments[5] : find_import(&FOLLOWING), *result = NULL;
    if (!parameters || !read_fields(parameters, &PARAMETERS, all.numbers) || !read_number(arguments[3], &all.top_speed))
        return NULL;
    Array *opened[] = {&all.speed, &all.acceleration, &all.times, &all.row, &all.gap_m};
    int open = 0;
    for (; open < 3; open++)
        if (!open_doubles(arguments[open < 2 ? open : 4], 1, opened[open])) break;
    if (open == 3 && open_field(arguments[2], &AHEAD, 0, 'l', 1, &all.row)) open++;
    if (open == 4 && open_field(arguments[2], &AHEAD, 1, 'd', 1, &all.gap_m)) open++;
    if (open == 5) result = predict(&all);
    close_arrays(open, opened);
    return result;
}

Functions planning_car_following = {
    FUNCTION(planning_car_following_predict_travel),
    END_OF_FUNCTIONS,
};
