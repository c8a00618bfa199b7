/* Twins of impact.py, which contact.c calls. */
#include "impact.h"

#include <stdlib.h>
#include <string.h>

static const double PENETRATION_TOLERANCE_M = 1e-3, CONTACT_DISTANCE_M = 0.01, FRICTION = 0.5;

static RigidBody *allocate_body(Py_ssize_t corners, Py_ssize_t normals) {
    RigidBody *body = calloc(1, sizeof *body + (2 * corners + normals) * sizeof(Point));
    if (!body) {
        PyErr_NoMemory();
        return NULL;
    }
    body->corners = corners, body->normals = normals;
    body->start = (Point *)(body + 1), body->end = body->start + corners, body->normal = body->end + corners;
    return body;
}

RigidBody *build_static_body(const Point *piece, Py_ssize_t count) {
    if (count < 1) return (RigidBody *)refuse_numbers("resolve_contacts");
    RigidBody *body = allocate_body(count, count);
    for (Py_ssize_t i = 0; body && i < count; i++) {
        Point here = piece[i], next = piece[i + 1 < count ? i + 1 : 0];
        double dx = next.x - here.x, dy = next.y - here.y, length = portable_hypot(dx, dy);
        body->start[i] = body->end[i] = here;
        body->normal[i] = (Point){dy / length, -dx / length};
        if (length == 0.0) {
            free(body);
            return (RigidBody *)refuse_numbers("resolve_contacts");
        }
    }
    return body;
}

RigidBody *build_box_body(Pose before, Pose after, double length, double width) {
    bool has_turned = after.yaw != before.yaw;
    CosSin now = cos_sin(after.yaw), then = cos_sin(before.yaw);
    if (!isfinite(now.cos) || !isfinite(then.cos)) return (RigidBody *)refuse_numbers("resolve_contacts");
    RigidBody *body = allocate_body(4, has_turned ? 4 : 2);
    if (!body) return NULL;
    Box start = list_corners(before.x, before.y, then.cos, then.sin, length, width);
    Box end = list_corners(after.x, after.y, now.cos, now.sin, length, width);
    memcpy(body->start, &start, sizeof start);
    memcpy(body->end, &end, sizeof end);
    Point *normal = body->normal;
    *normal++ = (Point){now.cos, now.sin};
    if (has_turned) *normal++ = (Point){then.cos, then.sin};
    *normal++ = (Point){-now.sin, now.cos};
    if (has_turned) *normal++ = (Point){-then.sin, then.cos};
    body->centre = (Point){after.x, after.y};
    return body;
}

typedef struct {
    double low, high;
} Span;

static Span project(const Point *points, Py_ssize_t count, Point axis) {
    double first = points[0].x * axis.x + points[0].y * axis.y;
    Span span = {first, first};
    for (Py_ssize_t i = 1; i < count; i++) {
        double along = points[i].x * axis.x + points[i].y * axis.y;
        span = (Span){along < span.low ? along : span.low, along > span.high ? along : span.high};
    }
    return span;
}

static double compute_gap(const Point *first, Py_ssize_t first_count, const Point *second, Py_ssize_t second_count,
                          Point normal) {
    return project(second, second_count, normal).low - project(first, first_count, normal).high;
}

static const ContactManifold APART = {false, {1.0, 0.0}, 0.0};

/* What find_contact knows when it has looked along some of the directions. */
typedef struct {
    double entered, left, gap, overlap; /* the last one is the second number of the best rank */
    int rank;                           /* the first one */
    bool are_apart;
    ContactManifold meeting;
} Sweep;

/* Whether the bodies are not known to be clear of each other yet. */
static bool look_along(const RigidBody *first, const RigidBody *second, Point normal, Sweep *sweep) {
    double start = compute_gap(first->start, first->corners, second->start, second->corners, normal);
    double end = compute_gap(first->end, first->corners, second->end, second->corners, normal);
    if (end > sweep->gap) sweep->gap = end;
    if (start > -PENETRATION_TOLERANCE_M && end > -PENETRATION_TOLERANCE_M) {
        sweep->are_apart = true;
        return !(end > CONTACT_DISTANCE_M);
    }
    double share = start != end ? (start + PENETRATION_TOLERANCE_M) / (start - end) : 0.0;
    if (start <= -PENETRATION_TOLERANCE_M && -PENETRATION_TOLERANCE_M < end && share < sweep->left) sweep->left = share;
    int rank = start > -PENETRATION_TOLERANCE_M;
    double overlap = rank ? share : start;
    if (rank > sweep->rank || (rank == sweep->rank && overlap > sweep->overlap)) {
        sweep->rank = rank, sweep->overlap = overlap;
        sweep->entered = rank ? share : 0.0;
        sweep->meeting = (ContactManifold){true, normal, -end};
    }
    return true;
}

ContactManifold find_contact(const RigidBody *first, const RigidBody *second) {
    Sweep sweep = {0.0, 1.0, -INFINITY, -INFINITY, -1, false, {true, {1.0, 0.0}, 0.0}};
    for (const RigidBody *body = first; body; body = body == first ? second : NULL) {
        for (Py_ssize_t i = 0; i < body->normals; i++) {
            Point normal = body->normal[i];
            if (!look_along(first, second, normal, &sweep)) return APART;
            if (!look_along(first, second, (Point){-normal.x, -normal.y}, &sweep)) return APART;
        }
    }
    if (!sweep.are_apart && !(sweep.entered > sweep.left) &&
        !(sweep.rank == 0 && sweep.gap > -PENETRATION_TOLERANCE_M))
        return sweep.meeting;
    if (!(sweep.gap <= CONTACT_DISTANCE_M)) return APART;
    return (ContactManifold){true, sweep.meeting.normal, 0.0};
}

static void shift(RigidBody *body, double dx, double dy) {
    if (!body->inverse_mass) return;
    for (Py_ssize_t i = 0; i < body->corners; i++) body->end[i] = (Point){body->end[i].x + dx, body->end[i].y + dy};
    body->centre = (Point){body->centre.x + dx, body->centre.y + dy};
    body->is_changed = true;
}

/* The extent across the normal of the corners that lie within contact distance of the foremost one: `side` 1 is the
   first body, whose greatest projection `limit` is, -1 the second one with its least. False if there are none. */
static bool find_extent(const RigidBody *body, Point normal, double limit, int side, Span *extent) {
    bool is_found = false;
    for (Py_ssize_t i = 0; i < body->corners; i++) {
        Point at = body->end[i];
        double along = at.x * normal.x + at.y * normal.y, across = at.y * normal.x - at.x * normal.y;
        if (!(side > 0 ? along > limit - CONTACT_DISTANCE_M : along < limit + CONTACT_DISTANCE_M)) continue;
        if (!is_found) *extent = (Span){across, across};
        else *extent = (Span){across < extent->low ? across : extent->low, across > extent->high ? across : extent->high};
        is_found = true;
    }
    return is_found;
}

static Point contact_point(const RigidBody *first, const RigidBody *second, Point normal, bool *is_refused) {
    double most = project(first->end, first->corners, normal).high;
    double least_along = project(second->end, second->corners, normal).low;
    Span a = {NAN, NAN}, b = {NAN, NAN};
    if (!find_extent(first, normal, most, 1, &a) || !find_extent(second, normal, least_along, -1, &b))
        *is_refused = true;
    double low = b.low > a.low ? b.low : a.low, high = b.high < a.high ? b.high : a.high, along = (low + high) / 2;
    return (Point){most * normal.x - along * normal.y, most * normal.y + along * normal.x};
}

static double lever(const RigidBody *body, Point point, Point axis) {
    return (point.x - body->centre.x) * axis.y - (point.y - body->centre.y) * axis.x;
}

static double inverse_mass_at(const RigidBody *body, Point point, Point axis) {
    double arm = lever(body, point, axis);
    return body->inverse_mass + body->inverse_inertia * (arm * arm);
}

static double speed_at(const RigidBody *body, Point point, Point axis) {
    double straight = body->velocity.x * axis.x + body->velocity.y * axis.y;
    return straight + body->yaw_rate * lever(body, point, axis);
}

static void apply_impulse(RigidBody *body, Point point, Point axis, double impulse) {
    if (!body->inverse_mass) return;
    double change = impulse * body->inverse_mass;
    body->velocity = (Point){body->velocity.x + change * axis.x, body->velocity.y + change * axis.y};
    body->yaw_rate = body->yaw_rate + impulse * body->inverse_inertia * lever(body, point, axis);
}

static double apply_stopping_impulse(RigidBody *first, RigidBody *second, Point point, Point axis, Span limits,
                                     bool *is_refused) {
    double speed = speed_at(second, point, axis) - speed_at(first, point, axis);
    double inverse_mass = inverse_mass_at(first, point, axis) + inverse_mass_at(second, point, axis);
    double impulse = divide(-speed, inverse_mass, is_refused);
    impulse = impulse < limits.high ? impulse : limits.high;
    impulse = impulse > limits.low ? impulse : limits.low;
    apply_impulse(first, point, axis, -impulse);
    apply_impulse(second, point, axis, impulse);
    return impulse;
}

void resolve_collision(RigidBody *first, RigidBody *second, const ContactManifold *meeting, bool *is_refused) {
    Point normal = meeting->normal;
    double share = divide(meeting->depth, first->inverse_mass + second->inverse_mass, is_refused);
    shift(first, -normal.x * share * first->inverse_mass, -normal.y * share * first->inverse_mass);
    shift(second, normal.x * share * second->inverse_mass, normal.y * share * second->inverse_mass);
    Point point = contact_point(first, second, normal, is_refused);
    double press = apply_stopping_impulse(first, second, point, normal, (Span){0.0, INFINITY}, is_refused);
    double rub = FRICTION * press;
    apply_stopping_impulse(first, second, point, (Point){-normal.y, normal.x}, (Span){-rub, rub}, is_refused);
}

Functions vehicle_impact = {END_OF_FUNCTIONS};
