/* Twin of contact.py: all contacts of a tick in one call. */
#include <stdlib.h>

#include "../core/compiled/values.h"
#include "../core/geometry.h"
#include "dynamics.h"
#include "impact.h"

enum { MAX_PASSES = 16, STATIC = 3, VEHICLE = 0 };
static const double MAX_SWEEP_M = 5.0, MARGIN_M = 1.0, TICK_S = 1.0 / 20;

static Import CONTACT = {"mdrive_sumo.core.state", "Contact", 0}, KIND = {"mdrive_sumo.core.state", "Kind", 0};
FIELDS(CONTACT_FIELDS, "ego", "other", "kind");
FIELDS(PLACE_FIELDS, "x", "y");
FIELDS(VEHICLE_FIELDS, "length", "width", "mass", "yaw_inertia");
FIELDS(MOTION_FIELDS, "before", "after");
FIELDS(ACTOR_FIELDS, "x", "y", "yaw", "length", "width", "kind", "ids");
FIELDS(WALL_FIELDS, "pieces", "centre", "half");

typedef struct {
    double length, width, mass, yaw_inertia;
} Vehicle;
typedef struct {
    PyObject *id, *state; /* borrowed of the dict of states */
    PyObject *start;      /* the state before */
    Vehicle vehicle;
    Point place;
    double reach;
    RigidBody *body; /* NULL, and no states, as long as nothing is near */
    VehicleState before, after;
} Cav;

/* Columns of the actors at the start of the tick (x, y, yaw) and at its end (x, y, yaw, length, width). */
enum { COLUMNS = 8 };
typedef struct {
    Array column[COLUMNS], kind;
    PyObject *ids;
    Py_ssize_t count;
    int opened;
    bool has_kind;
} Actors;
typedef struct {
    PyObject *pieces;
    Array centre, half;
    int opened;
    Py_ssize_t count;
} Walls;

/* A CAV and what it may touch: another CAV, an actor's row, or ~number of a piece of wall. */
typedef struct {
    Cav *ego, *other;
    RigidBody *body; /* of the actor or the wall */
    Py_ssize_t row;
    bool is_met;
} Pair;
typedef struct {
    Cav *cavs; /* in the order of their ids */
    Py_ssize_t cav_count;
    Actors actors;
    Walls walls;
    Pair *pairs;
    Py_ssize_t pair_count, pair_room;
} Scene;

/* What tells whether anything is near; `read_states` reads the rest. */
static bool read_place(PyObject *id, PyObject *state, PyObject *before, PyObject *vehicles, Cav *cav) {
    *cav = (Cav){.id = id, .state = state, .start = PyObject_GetItem(before, id)};
    PyObject *vehicle = cav->start ? PyObject_GetItem(vehicles, id) : NULL;
    Point from, to;
    bool is_read = vehicle && read_fields(cav->start, &PLACE_FIELDS, (double *)&from) &&
                   read_fields(state, &PLACE_FIELDS, (double *)&to) &&
                   read_fields(vehicle, &VEHICLE_FIELDS, (double *)&cav->vehicle);
    if (vehicle) Py_DecRef(vehicle);
    if (!is_read) return false;
    double x = fabs(to.x - from.x), y = fabs(to.y - from.y);
    cav->place = to;
    cav->reach = (cav->vehicle.length + cav->vehicle.width) / 2 + (y > x ? y : x) + MARGIN_M;
    return true;
}

/* The CAVs in the order of their ids. */
static bool read_cavs(PyObject *before, PyObject *after, PyObject *vehicles, Scene *scene) {
    if (!PyType_IsSubtype(after->ob_type, &PyDict_Type)) {
        PyErr_SetString(PyExc_TypeError, "resolve_contacts: expected a dict of states at the end of the tick");
        return false;
    }
    scene->cavs = malloc((PyObject_Size(after) + 1) * sizeof *scene->cavs);
    if (!scene->cavs) return PyErr_NoMemory() != NULL;
    PyObject *id, *state;
    for (Py_ssize_t position = 0; PyDict_Next(after, &position, &id, &state);) {
        Cav cav;
        bool is_read = read_place(id, state, before, vehicles, &cav);
        Py_ssize_t place = scene->cav_count++;
        for (; place > 0 && PyUnicode_Compare(id, scene->cavs[place - 1].id) < 0; place--)
            scene->cavs[place] = scene->cavs[place - 1];
        scene->cavs[place] = cav;
        if (!is_read || PyErr_Occurred()) return false;
    }
    return true;
}

static bool open_column(PyObject *object, int field, char kind, Array *array) {
    PyObject *column = get_field(object, &ACTOR_FIELDS, field);
    bool is_open = column && open_array(column, kind, array); /* keeps a reference of its own */
    if (column) Py_DecRef(column);
    return is_open;
}

static bool open_columns(PyObject *before, PyObject *after, Actors *actors) {
    if (!(actors->ids = get_field(after, &ACTOR_FIELDS, 6))) return false;
    if (!(actors->count = PyTuple_Size(actors->ids))) return true;
    for (int i = 0; i < COLUMNS; i++) {
        if (!open_column(i < 3 ? before : after, i < 3 ? i : i - 3, 'd', actors->column + i)) return false;
        actors->opened++;
    }
    if (!(actors->has_kind = open_column(after, 5, 'B', &actors->kind))) return false;
    bool is_whole = actors->kind.count == actors->count;
    for (int i = 0; i < COLUMNS; i++) is_whole = is_whole && actors->column[i].count == actors->count;
    if (!is_whole && !PyErr_Occurred())
        PyErr_SetString(PyExc_ValueError, "resolve_contacts: expected as many numbers in every column of actors");
    return is_whole;
}

static bool open_actors(PyObject *motion, Actors *actors) {
    PyObject *before = get_field(motion, &MOTION_FIELDS, 0), *after = before ? get_field(motion, &MOTION_FIELDS, 1) : NULL;
    bool are_open = after && open_columns(before, after, actors);
    if (before) Py_DecRef(before);
    if (after) Py_DecRef(after);
    return are_open;
}

static bool open_walls(PyObject *buildings, Walls *walls) {
    walls->pieces = get_field(buildings, &WALL_FIELDS, 0);
    if (!walls->pieces || (walls->count = PyTuple_Size(walls->pieces)) < 0) return false;
    if (!walls->count) return true;
    for (int i = 0; i < 2; i++) {
        PyObject *rows = get_field(buildings, &WALL_FIELDS, i + 1);
        bool is_open = rows && open_doubles(rows, 2, i ? &walls->half : &walls->centre);
        if (rows) Py_DecRef(rows);
        if (!is_open) return false;
        walls->opened++;
    }
    if (walls->centre.count == 2 * walls->count && walls->half.count == 2 * walls->count) return true;
    PyErr_SetString(PyExc_ValueError, "resolve_contacts: expected the bounds (2, M) of M pieces of wall");
    return false;
}

static void close_scene(Scene *scene) {
    for (Py_ssize_t i = 0; i < scene->cav_count; i++) {
        free(scene->cavs[i].body);
        if (scene->cavs[i].start) Py_DecRef(scene->cavs[i].start);
    }
    for (Py_ssize_t i = 0; i < scene->pair_count; i++) free(scene->pairs[i].body);
    free(scene->cavs);
    free(scene->pairs);
    for (int i = 0; i < scene->actors.opened; i++) close_array(scene->actors.column + i);
    if (scene->actors.has_kind) close_array(&scene->actors.kind);
    if (scene->actors.ids) Py_DecRef(scene->actors.ids);
    if (scene->walls.opened > 0) close_array(&scene->walls.centre);
    if (scene->walls.opened > 1) close_array(&scene->walls.half);
    if (scene->walls.pieces) Py_DecRef(scene->walls.pieces);
}

static bool add_pair(Scene *scene, Cav *ego, Cav *other, Py_ssize_t row) {
    if (scene->pair_count == scene->pair_room) {
        Py_ssize_t room = 2 * scene->pair_room + 16;
        Pair *pairs = realloc(scene->pairs, room * sizeof *pairs);
        if (!pairs) return PyErr_NoMemory() != NULL;
        scene->pairs = pairs, scene->pair_room = room;
    }
    scene->pairs[scene->pair_count++] = (Pair){ego, other, NULL, row, false};
    return true;
}

static bool pair_with_actors(Scene *scene, Cav *ego) {
    const Array *column = scene->actors.column;
    const double *x0 = doubles(column), *y0 = doubles(column + 1), *x1 = doubles(column + 3), *y1 = doubles(column + 4);
    const double *length = doubles(column + 6), *width = doubles(column + 7);
    double x = ego->place.x, y = ego->place.y;
    for (Py_ssize_t j = 0; j < scene->actors.count; j++) {
        double moved_x = fabs(x1[j] - x0[j]), moved_y = fabs(y1[j] - y0[j]);
        double swept = moved_x > moved_y || isnan(moved_x) ? moved_x : moved_y, radius = (length[j] + width[j]) / 2 + swept;
        if (fabs(x1[j] - x) - radius < ego->reach && fabs(y1[j] - y) - radius < ego->reach &&
            !add_pair(scene, ego, NULL, j))
            return false;
    }
    return true;
}

static bool pair_with_walls(Scene *scene, Cav *ego) {
    Py_ssize_t count = scene->walls.count;
    const double *centre = doubles(&scene->walls.centre), *half = doubles(&scene->walls.half);
    for (Py_ssize_t j = 0; j < count; j++)
        if (fabs(centre[j] - ego->place.x) - half[j] < ego->reach &&
            fabs(centre[count + j] - ego->place.y) - half[count + j] < ego->reach && !add_pair(scene, ego, NULL, ~j))
            return false;
    return true;
}

/* CAVs in the order of their ids, then actors, then walls. */
static bool find_close_pairs(Scene *scene) {
    Cav *end = scene->cavs + scene->cav_count;
    for (Cav *ego = scene->cavs; ego < end; ego++) {
        for (Cav *other = ego + 1; other < end; other++) {
            double reach = ego->reach + other->reach;
            if (fabs(other->place.x - ego->place.x) < reach && fabs(other->place.y - ego->place.y) < reach &&
                !add_pair(scene, ego, other, 0))
                return false;
        }
    }
    for (Cav *ego = scene->cavs; ego < end; ego++)
        if (!pair_with_actors(scene, ego)) return false;
    for (Cav *ego = scene->cavs; ego < end; ego++)
        if (!pair_with_walls(scene, ego)) return false;
    return true;
}

static bool build_ego_body(Cav *cav) {
    if (cav->body) return true;
    if (!read_vehicle_state(cav->start, &cav->before) || !read_vehicle_state(cav->state, &cav->after)) return false;
    const VehicleState *before = &cav->before, *after = &cav->after;
    CosSin ahead = cos_sin(after->yaw);
    bool is_refused = false;
    double inverse_mass = divide(1, cav->vehicle.mass, &is_refused);
    double inverse_inertia = divide(1, cav->vehicle.yaw_inertia, &is_refused);
    if (is_refused) return refuse_numbers("resolve_contacts") != NULL;
    cav->body = build_box_body((Pose){before->x, before->y, before->yaw}, (Pose){after->x, after->y, after->yaw},
                               cav->vehicle.length, cav->vehicle.width);
    if (!cav->body) return false;
    cav->body->velocity =
        (Point){ahead.cos * after->vx - ahead.sin * after->vy, ahead.sin * after->vx + ahead.cos * after->vy};
    cav->body->yaw_rate = after->yaw_rate;
    cav->body->inverse_mass = inverse_mass, cav->body->inverse_inertia = inverse_inertia;
    return true;
}

static RigidBody *build_actor_body(const Actors *actors, Py_ssize_t row) {
    double value[COLUMNS];
    for (int i = 0; i < COLUMNS; i++) value[i] = doubles(actors->column + i)[row];
    Pose before = {value[0], value[1], value[2]}, after = {value[3], value[4], value[5]};
    double moved_x = fabs(after.x - before.x), moved_y = fabs(after.y - before.y);
    if ((moved_y > moved_x ? moved_y : moved_x) > MAX_SWEEP_M) before = after;
    RigidBody *body = build_box_body(before, after, value[6], value[7]);
    if (!body) return NULL;
    body->velocity = (Point){(after.x - before.x) / TICK_S, (after.y - before.y) / TICK_S};
    body->yaw_rate = wrap_angle(after.yaw - before.yaw) / TICK_S;
    return body;
}

static RigidBody *build_wall_body(const Walls *walls, Py_ssize_t number) {
    PyObject *piece = PyTuple_GetItem(walls->pieces, number);
    Py_ssize_t count = piece ? PyTuple_Size(piece) : -1;
    Point *corners = count < 0 ? NULL : malloc((count + 1) * sizeof *corners);
    if (count >= 0 && !corners) PyErr_NoMemory();
    bool is_read = corners != NULL;
    for (Py_ssize_t i = 0; is_read && i < count; i++) {
        PyObject *corner = PyTuple_GetItem(piece, i), *x = PyTuple_GetItem(corner, 0), *y = x ? PyTuple_GetItem(corner, 1) : NULL;
        is_read = y && read_number(x, &corners[i].x) && read_number(y, &corners[i].y);
    }
    RigidBody *body = is_read ? build_static_body(corners, count) : NULL;
    free(corners);
    return body;
}

static bool build_bodies(Scene *scene) {
    for (Pair *pair = scene->pairs; pair < scene->pairs + scene->pair_count; pair++) {
        if (!build_ego_body(pair->ego) || (pair->other && !build_ego_body(pair->other))) return false;
        if (pair->other) continue;
        pair->body = pair->row >= 0 ? build_actor_body(&scene->actors, pair->row) : build_wall_body(&scene->walls, ~pair->row);
        if (!pair->body) return false;
    }
    return true;
}

/* Whether it was necessary to separate the pair. */
static bool separate_pair(Pair *pair, bool *is_refused) {
    RigidBody *first = pair->ego->body, *second = pair->other ? pair->other->body : pair->body;
    ContactManifold contact = find_contact(first, second);
    if (!contact.is_there) return false;
    pair->is_met = true;
    if (contact.depth == 0.0) return false;
    resolve_collision(first, second, &contact, is_refused);
    return true;
}

static bool separate_pairs(Scene *scene) {
    bool is_refused = false, is_pushed = true;
    for (int i = 0; i < MAX_PASSES && is_pushed && !is_refused; i++) {
        is_pushed = false;
        for (Pair *pair = scene->pairs; pair < scene->pairs + scene->pair_count && !is_refused; pair++)
            if (separate_pair(pair, &is_refused)) is_pushed = true;
    }
    return !is_refused || refuse_numbers("resolve_contacts") != NULL;
}

/* The state of a CAV after the tick: the proposed object where nothing pushed it. A new reference. */
static PyObject *to_vehicle_state(const Cav *cav) {
    if (!cav->body || !cav->body->is_changed) return new_reference(cav->state);
    VehicleState state = cav->after;
    Point velocity = cav->body->velocity;
    CosSin ahead = cos_sin(state.yaw);
    state.x = cav->body->centre.x, state.y = cav->body->centre.y;
    state.vx = ahead.cos * velocity.x + ahead.sin * velocity.y;
    state.vy = ahead.cos * velocity.y - ahead.sin * velocity.x;
    state.yaw_rate = cav->body->yaw_rate;
    state.acceleration = (state.vx - cav->before.vx) / TICK_S;
    return build_vehicle_state(&state);
}

/* In the order of `after`. */
static PyObject *build_settled(const Scene *scene, PyObject *after) {
    PyObject *settled = PyDict_New(), *id, *proposed;
    for (Py_ssize_t position = 0; settled && PyDict_Next(after, &position, &id, &proposed);) {
        const Cav *cav = scene->cavs, *end = cav + scene->cav_count;
        while (cav < end && cav->id != id) cav++;
        PyObject *state = cav < end ? to_vehicle_state(cav) : NULL;
        if (!state || PyDict_SetItem(settled, id, state)) {
            Py_DecRef(settled);
            settled = NULL;
        }
        if (state) Py_DecRef(state);
    }
    return settled;
}

/* What one contact tells of: ids are borrowed, that of a wall is NULL. */
typedef struct {
    PyObject *ego, *other;
    int kind;
} Meeting;

static int compare_meetings(const Meeting *first, const Meeting *second) {
    int order = PyUnicode_Compare(first->ego, second->ego);
    if (order) return order;
    if (!first->other || !second->other) return (first->other != NULL) - (second->other != NULL);
    return PyUnicode_Compare(first->other, second->other);
}

/* Adds a meeting in its place, if it is not there yet. */
static void add_meeting(Meeting *meetings, Py_ssize_t *count, Meeting meeting) {
    Py_ssize_t place = *count;
    while (place > 0 && compare_meetings(&meeting, meetings + place - 1) < 0) place--;
    if (place > 0 && compare_meetings(&meeting, meetings + place - 1) == 0) return;
    for (Py_ssize_t i = (*count)++; i > place; i--) meetings[i] = meetings[i - 1];
    meetings[place] = meeting;
}

static PyObject *build_contact(Meeting meeting) {
    PyObject *class = find_import(&KIND), *number = PyLong_FromSsize_t(meeting.kind);
    PyObject *kind = class && number ? PyObject_CallFunctionObjArgs(class, number, NULL) : NULL;
    if (number) Py_DecRef(number);
    PyObject *other = meeting.other ? new_reference(meeting.other) : PyUnicode_FromString("");
    return build_instance(&CONTACT, &CONTACT_FIELDS, (PyObject *[]){new_reference(meeting.ego), other, kind});
}

static PyObject *build_contacts(const Scene *scene) {
    Meeting *meetings = malloc((2 * scene->pair_count + 1) * sizeof *meetings);
    if (!meetings) return PyErr_NoMemory();
    Py_ssize_t count = 0;
    for (const Pair *pair = scene->pairs; pair < scene->pairs + scene->pair_count; pair++) {
        if (!pair->is_met) continue;
        PyObject *ego = pair->ego->id;
        if (pair->other) {
            add_meeting(meetings, &count, (Meeting){ego, pair->other->id, VEHICLE});
            add_meeting(meetings, &count, (Meeting){pair->other->id, ego, VEHICLE});
        } else if (pair->row >= 0) {
            int kind = ((const unsigned char *)scene->actors.kind.data)[pair->row];
            add_meeting(meetings, &count, (Meeting){ego, PyTuple_GetItem(scene->actors.ids, pair->row), kind});
        } else {
            add_meeting(meetings, &count, (Meeting){ego, NULL, STATIC});
        }
    }
    PyObject *contacts = PyTuple_New(count);
    for (Py_ssize_t i = 0; contacts && i < count; i++) {
        PyObject *contact = build_contact(meetings[i]);
        if (!contact || PyTuple_SetItem(contacts, i, contact)) {
            Py_DecRef(contacts);
            contacts = NULL;
        }
    }
    free(meetings);
    return contacts;
}

static PyObject *vehicle_contact_resolve_contacts(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("resolve_contacts", count, 5, 5)) return NULL;
    Scene scene = {0};
    PyObject *result = NULL;
    if (read_cavs(arguments[0], arguments[1], arguments[2], &scene) && open_actors(arguments[3], &scene.actors) &&
        open_walls(arguments[4], &scene.walls) && find_close_pairs(&scene) && build_bodies(&scene) &&
        separate_pairs(&scene))
        result = pack(2, build_settled(&scene, arguments[1]), build_contacts(&scene));
    close_scene(&scene);
    if (result && PyErr_Occurred()) { /* ids that are no texts */
        Py_DecRef(result);
        return NULL;
    }
    return result;
}

Functions vehicle_contact = {
    FUNCTION(vehicle_contact_resolve_contacts),
    END_OF_FUNCTIONS,
};
