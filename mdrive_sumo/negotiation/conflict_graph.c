/* Twins of conflict_graph.py: all pairs of trajectories in one call. */
#include <stdlib.h>

#include "intention.h"

static Import TRAJECTORY_PAIRS = {"mdrive_sumo.negotiation.conflict_graph", "TrajectoryPairs", 0};
FIELDS(PAIRS, "distance", "step", "in_conflict", "distance_to_conflict", "entry_time");

/* Trajectories (count, POINTS) and what their comparison takes. */
typedef struct {
    Py_ssize_t count;
    const Point *points;
    double min_distance_m, max_step_m, free_m;
    bool is_close; /* points are no further apart than max_step_m */
} Trajectories;

/* What is known of a pair. */
typedef struct {
    double distance, entry_time;
    Py_ssize_t step;
} Pair;

static double measure(Point a, Point b) { return portable_hypot(a.x - b.x, a.y - b.y); }

static bool have_short_steps(const Trajectories *all) {
    double longest = -INFINITY;
    for (Py_ssize_t i = 0; i < all->count; i++)
        for (Py_ssize_t k = i * POINTS; k < (i + 1) * POINTS - 1; k++) {
            double dx = all->points[k + 1].x - all->points[k].x, dy = all->points[k + 1].y - all->points[k].y;
            double square = dx * dx + dy * dy;
            if (!(square <= longest)) longest = square;
        }
    return longest <= all->max_step_m * all->max_step_m;
}

/* The least distance of two cars between two points. */
static double measure_between(const Point *mine, const Point *theirs) {
    double before_x = mine[0].x - theirs[0].x, before_y = mine[0].y - theirs[0].y;
    double change_x = (mine[1].x - mine[0].x) - (theirs[1].x - theirs[0].x);
    double change_y = (mine[1].y - mine[0].y) - (theirs[1].y - theirs[0].y);
    double square = change_x * change_x + change_y * change_y, ahead = before_x * change_x + before_y * change_y;
    double share = -ahead / (square > 1e-9 ? square : 1e-9);
    share = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
    return portable_hypot(before_x + share * change_x, before_y + share * change_y);
}

static Pair compare(const Trajectories *all, Py_ssize_t i, Py_ssize_t j) {
    const Point *mine = all->points + i * POINTS, *theirs = all->points + j * POINTS;
    Pair pair = {INFINITY, INFINITY, 0};
    for (Py_ssize_t k = 0; k < POINTS; k++) {
        double gap = measure(mine[k], theirs[k]);
        if (k && !all->is_close) gap = least(measure_between(mine + k - 1, theirs + k - 1), gap);
        if (gap < pair.distance) pair.distance = gap, pair.step = k;
        for (Py_ssize_t m = 0; isinf(pair.entry_time) && m < POINTS; m++)
            if (measure(mine[k], theirs[m]) < all->min_distance_m) pair.entry_time = (double)(k + 1) * INTERVAL_S;
    }
    return pair;
}

static void fill_row(const Trajectories *all, Py_ssize_t i, double *distance, int64_t *step, bool *in_conflict,
                     double *to_conflict, double *entry_time) {
    *to_conflict = all->free_m;
    for (Py_ssize_t j = 0; j < all->count; j++) {
        Pair pair = compare(all, i, j);
        step[j] = pair.step;
        distance[j] = i == j ? INFINITY : pair.distance, entry_time[j] = i == j ? INFINITY : pair.entry_time;
        in_conflict[j] = distance[j] < all->min_distance_m;
        double driven = measure(all->points[i * POINTS + pair.step], all->points[i * POINTS]);
        if (i != j && driven < *to_conflict) *to_conflict = driven;
    }
}

static PyObject *build_pairs(const Trajectories *all) {
    Py_ssize_t count = all->count, shape[] = {count, count};
    double *distance, *to_conflict, *entry_time;
    void *step, *in_conflict;
    PyObject *values[] = {new_doubles(2, shape, &distance), new_array('l', 2, shape, &step),
                          new_array('?', 2, shape, &in_conflict), new_doubles(1, &count, &to_conflict),
                          new_doubles(2, shape, &entry_time)};
    bool are_built = values[0] && values[1] && values[2] && values[3] && values[4];
    for (Py_ssize_t i = 0; are_built && i < count; i++)
        fill_row(all, i, distance + i * count, (int64_t *)step + i * count, (bool *)in_conflict + i * count, to_conflict + i,
                 entry_time + i * count);
    return build_instance(&TRAJECTORY_PAIRS, &PAIRS, values);
}

static PyObject *negotiation_conflict_graph_compare_trajectories(PyObject *module, PyObject *const *arguments,
                                                                 Py_ssize_t count) {
    double numbers[3];
    Array points;
    if (!expect_arguments("compare_trajectories", count, 4, 4) || !read_numbers(arguments + 1, 3, numbers) ||
        !open_doubles(arguments[0], 3, &points))
        return NULL;
    PyObject *result = NULL;
    if (points.shape[1] == POINTS && points.shape[2] == 2) {
        Trajectories all = {points.shape[0], points.data, numbers[0], numbers[1], numbers[2], true};
        all.is_close = !all.count || have_short_steps(&all);
        result = build_pairs(&all);
    } else {
        PyErr_Format(PyExc_ValueError, "expected trajectories of %d points", (int)POINTS);
    }
    close_array(&points);
    return result;
}

Functions negotiation_conflict_graph = {
    FUNCTION(negotiation_conflict_graph_compare_trajectories),
    END_OF_FUNCTIONS,
};
