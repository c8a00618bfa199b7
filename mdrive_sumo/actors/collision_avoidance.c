/* Twin of collision_avoidance.py, with actor_surroundings.list_surroundings. */
#include <stdlib.h>

#include "../core/state.h"
#include "look_ahead.h"

static const double WAITING_SPEED = 0.1, HEAD_ON_COS = -0.95;
static Import CAR_SIZE = {"mdrive_sumo.actors.actor_surroundings", "CAR_SIZE", 0};
FIELDS(EGO, "x", "y", "yaw", "speed");

typedef struct {
    MoversOnPaths open;
    double now_s;
    Surrounding *others;
    Py_ssize_t count;
    FreeSpeed *free; /* of each mover */
    Py_ssize_t *waits_for; /* mover that each mover waits for, -1 if it waits for none */
} Scene;

static bool list_egos(PyObject *egos, Scene *scene) {
    PyObject *size = find_import(&CAR_SIZE);
    double length, width;
    if (!size || !read_number(PyTuple_GetItem(size, 0), &length) || !read_number(PyTuple_GetItem(size, 1), &width))
        return false;
    for (Py_ssize_t i = 0; i < PyTuple_Size(egos); i++) {
        Surrounding *ego = scene->others + scene->count++;
        *ego = (Surrounding){
            .half_length = length / 2, .half_width = width / 2, .is_cav = true, .index = NO_MOVER};
        if (!read_fields(PyTuple_GetItem(egos, i), &EGO, &ego->x)) return false;
    }
    return true;
}

static bool list_actors(const RoadUsers *actors, PyObject *index_by_id, Scene *scene) {
    for (Py_ssize_t i = 0; i < actors->count; i++) {
        Surrounding *actor = scene->others + scene->count++;
        *actor = (Surrounding){.x = x_of(actors)[i],
                               .y = y_of(actors)[i],
                               .yaw = yaws_of(actors)[i],
                               .speed = speeds_of(actors)[i],
                               .half_length = lengths_of(actors)[i] / 2,
                               .half_width = widths_of(actors)[i] / 2,
                               .is_pedestrian = kinds_of(actors)[i] == PEDESTRIAN,
                               .index = NO_MOVER};
        PyObject *index = PyDict_GetItemWithError(index_by_id, PyTuple_GetItem(actors->ids, i));
        if (index ? !read_integer(index, &actor->index) : !!PyErr_Occurred()) return false;
        if (actor->index >= scene->open.count) {
            PyErr_SetString(PyExc_ValueError, "expected an index of a mover for each scripted actor");
            return false;
        }
    }
    return true;
}

static bool is_on_log(const Mover *mover, double now_s) {
    return mover->is_timed && fabs(now_s - mover->progress) < LOG_TIME_TOLERANCE_S;
}

static bool considers(const Scene *scene, Py_ssize_t row, const Surrounding *other) {
    const Mover *mover = scene->open.mover + row;
    if (other->index == row || (mover->is_pedestrian && other->is_pedestrian)) return false;
    if (mover->is_timed && other->index == STATIC_ACTOR) return false;
    return other->index < 0 || !is_on_log(mover, scene->now_s) ||
           !is_on_log(scene->open.mover + other->index, scene->now_s);
}

static bool compute_free_speed(const Scene *scene, Py_ssize_t row, bool ignores_movers, FreeSpeed *free) {
    Looker looker = start_looking(&scene->open, row);
    *free = (FreeSpeed){INFINITY, -1};
    for (Py_ssize_t i = 0; i < scene->count; i++) {
        const Surrounding *other = scene->others + i;
        if (ignores_movers && other->index >= 0) continue;
        if (considers(scene, row, other) && !limit_speed(&looker, other, i, free)) return false;
    }
    return true;
}

static bool looks_ahead(const Mover *mover) {
    bool has_arrived = mover->s >= mover->path_length && !mover->is_timed;
    return mover->avoids_collisions && mover->is_present && !has_arrived;
}

static void find_waiting(const Scene *scene) {
    for (Py_ssize_t row = 0; row < scene->open.count; row++) {
        const FreeSpeed *free = scene->free + row;
        Py_ssize_t blocker = free->blocker >= 0 ? scene->others[free->blocker].index : NO_MOVER;
        bool is_slow = free->speed < WAITING_SPEED && scene->open.mover[row].speed < WAITING_SPEED;
        scene->waits_for[row] = blocker >= 0 && is_slow ? blocker : -1;
    }
}

/* Whether `first` comes before `second` where one of a cycle has to proceed: a pedestrian first, else by id. */
static bool precedes(const Mover *movers, Py_ssize_t first, Py_ssize_t second) {
    bool one = movers[first].is_pedestrian, other = movers[second].is_pedestrian;
    return one != other ? one : first < second;
}

/* Whether a mover is the first of a cycle of movers that wait for one another. */
static bool is_first_in_cycle(const Scene *scene, Py_ssize_t row) {
    bool is_first = true;
    Py_ssize_t next = scene->waits_for[row];
    for (Py_ssize_t i = 0; i < scene->open.count && next >= 0; i++) {
        if (next == row) return is_first;
        is_first &= precedes(scene->open.mover, row, next);
        next = scene->waits_for[next];
    }
    return false;
}

/* False, with an error, where a heading is not finite. */
static bool is_deadlock_breaker(const Scene *scene, Py_ssize_t row, bool *is_breaker) {
    const Mover *mover = scene->open.mover;
    *is_breaker = is_first_in_cycle(scene, row);
    if (!*is_breaker || mover[row].is_pedestrian) return true;
    double cos = cos_sin(mover[row].yaw - mover[scene->waits_for[row]].yaw).cos;
    *is_breaker = cos > HEAD_ON_COS;
    if (!isfinite(cos)) PyErr_SetString(PyExc_ValueError, "expected finite headings, found NaN or infinity");
    return isfinite(cos);
}

static bool compute_limits(const Scene *scene, double *limits) {
    for (Py_ssize_t row = 0; row < scene->open.count; row++) {
        scene->free[row] = (FreeSpeed){INFINITY, -1};
        if (looks_ahead(scene->open.mover + row) && !compute_free_speed(scene, row, false, scene->free + row))
            return false;
        limits[row] = scene->free[row].speed;
    }
    find_waiting(scene);
    for (Py_ssize_t row = 0; row < scene->open.count; row++) {
        bool is_breaker;
        FreeSpeed free;
        if (!is_deadlock_breaker(scene, row, &is_breaker)) return false;
        if (!is_breaker) continue;
        if (!compute_free_speed(scene, row, true, &free)) return false;
        limits[row] = free.speed;
    }
    return true;
}

static PyObject *compute_speed_limits(Scene *scene, PyObject *egos, const RoadUsers *actors, PyObject *index_by_id) {
    Py_ssize_t movers = scene->open.count;
    double *limits;
    PyObject *result = new_doubles(1, &movers, &limits);
    scene->others = malloc((size_t)(PyTuple_Size(egos) + actors->count + 1) * sizeof *scene->others);
    scene->free = malloc((size_t)(movers + 1) * sizeof *scene->free);
    scene->waits_for = malloc((size_t)(movers + 1) * sizeof *scene->waits_for);
    bool is_complete = result && scene->others && scene->free && scene->waits_for;
    if (!is_complete) PyErr_NoMemory();
    is_complete = is_complete && list_egos(egos, scene) && list_actors(actors, index_by_id, scene);
    for (Py_ssize_t i = 0; is_complete && i < scene->count; i++) scene->others[i].heading = cos_sin(scene->others[i].yaw);
    is_complete = is_complete && compute_limits(scene, limits);
    free(scene->others);
    free(scene->free);
    free(scene->waits_for);
    if (is_complete || !result) return result;
    Py_DecRef(result);
    return NULL;
}

static PyObject *actors_collision_avoidance_compute_speed_limits(PyObject *module, PyObject *const *arguments,
                                                                 Py_ssize_t count) {
    Scene scene = {0};
    double tick;
    if (!expect_arguments("compute_speed_limits", count, 6, 6) || !read_number(arguments[2], &tick) ||
        PyTuple_Size(arguments[3]) < 0 || !open_movers_on_paths(arguments[0], arguments[1], &scene.open))
        return NULL;
    scene.now_s = tick * TICK_S;
    RoadUsers actors;
    PyObject *result = NULL;
    if (open_road_users(arguments[4], &actors)) {
        result = compute_speed_limits(&scene, arguments[3], &actors, arguments[5]);
        close_road_users(&actors);
    }
    close_movers_on_paths(&scene.open);
    return result;
}

Functions actors_collision_avoidance = {
    FUNCTION(actors_collision_avoidance_compute_speed_limits),
    END_OF_FUNCTIONS,
};
