/* Twin of tracker.py: the whole of a tracker's answer. */
#include <stdlib.h>

#include "plan_reader.h"

FIELDS(VEHICLE_FIELDS, "rear_to_centre", "wheelbase", "max_steer_angle", "max_acceleration", "max_deceleration");
typedef struct {
    double rear_to_centre, wheelbase, max_steer_angle, max_acceleration, max_deceleration;
} Vehicle;

static const double TICK_S = 1.0 / 20, PREVIEW_S = 0.8, LAG_S = 0.1;
static const double LOOK_AHEAD_M = 1.2, LOOK_AHEAD_S = 0.1, LOOK_AHEAD_S2 = 0.015;
static const double COASTING = 0.12, HOLD = 0.3, COLLAPSED = 0.1, DISTINCT = 1e-6, ENDS = 100.0;
static const double HORIZON_S = 3.0, HORIZON_M = 20.0;

typedef struct {
    double start, x, y, ux, uy, length;
} Hop;
typedef struct {
    double *stations;
    Hop *hops;
    Py_ssize_t count, hop_count;
} Line;

static OwnMotion predict_motion(const OwnMotion *own, bool *is_refused) {
    double speed = own->speed;
    if (own->speed >= 0.0) {
        double later = own->speed + own->acceleration * LAG_S;
        speed = later > 0.0 ? later : 0.0;
    }
    double driven_m = (own->speed + speed) / 2 * LAG_S, turn = own->yaw_rate * LAG_S;
    CosSin ahead = cos_sin(own->yaw + turn / 2);
    if (!isfinite(ahead.cos)) *is_refused = true;
    return (OwnMotion){
        .x = own->x + driven_m * ahead.cos, .y = own->y + driven_m * ahead.sin, .yaw = own->yaw + turn, .speed = speed};
}

static void build_line_to_point(double x, double y, const OwnMotion *own, Line *line, bool *is_refused) {
    CosSin heading = cos_sin(own->yaw);
    Point at = point_to_ego_frame(x, y, heading, own);
    double distance = at.x > COLLAPSED ? portable_hypot(at.x, at.y) : at.x;
    double yaw = own->yaw + (at.x > COLLAPSED ? portable_atan2(at.y, at.x) : 0.0);
    CosSin ahead = cos_sin(yaw);
    if (!isfinite(heading.cos) || !isfinite(ahead.cos)) *is_refused = true;
    for (Py_ssize_t i = 0; i < line->count; i++) line->stations[i] = distance;
    line->hop_count = 1;
    line->hops[0] =
        (Hop){-ENDS, own->x - ENDS * ahead.cos, own->y - ENDS * ahead.sin, ahead.cos, ahead.sin, 2 * ENDS};
}

/* `line` has room for as many stations and hops as the plan has points. */
static void build_line(const Plan *plan, const OwnMotion *own, double now_s, Line *line, bool *is_refused) {
    const Point *points = plan->points.data;
    double s = 0.0, x = points[0].x, y = points[0].y, enough = divide(now_s + HORIZON_S, plan->interval_s, is_refused);
    line->stations[0] = s, line->count = 1, line->hop_count = 0;
    for (Py_ssize_t i = 1; i < plan->points.shape[0]; i++) {
        double u = points[i].x, v = points[i].y, length = portable_hypot(u - x, v - y);
        if (length > DISTINCT) {
            line->hops[line->hop_count++] = (Hop){s, x, y, (u - x) / length, (v - y) / length, length};
            s = s + length, x = u, y = v;
        }
        line->stations[line->count++] = s;
        if (s > HORIZON_M && line->count > enough) break;
    }
    if (s < COLLAPSED) {
        build_line_to_point(x, y, own, line, is_refused);
        return;
    }
    Hop *first = line->hops;
    *first = (Hop){first->start - ENDS,      first->x - ENDS * first->ux, first->y - ENDS * first->uy, first->ux, first->uy,
                   first->length + ENDS};
    line->hops[line->hop_count - 1].length += ENDS;
}

static double project_on_line(const Line *line, double x, double y) {
    double least_gap = INFINITY, here = 0.0;
    for (const Hop *hop = line->hops; hop < line->hops + line->hop_count; hop++) {
        double dx = x - hop->x, dy = y - hop->y, along = dx * hop->ux + dy * hop->uy, aside = dx * hop->uy - dy * hop->ux;
        double on = along < 0.0 ? 0.0 : along > hop->length ? hop->length : along;
        double gap = aside * aside + (along - on) * (along - on);
        if (gap < least_gap) least_gap = gap, here = hop->start + on;
    }
    return here;
}

static double find_station(const Line *line, double interval_s, double now_s, bool *is_refused) {
    const double later = LAG_S + PREVIEW_S, *stations = line->stations;
    if (now_s > line->count * interval_s) return stations[line->count - 1];
    if (line->count == 1) return stations[0] * later / greatest(TICK_S, interval_s - now_s);
    double index = divide(now_s + later, interval_s, is_refused) - 1;
    if (!isfinite(index)) *is_refused = true;
    if (*is_refused) return 0.0;
    Py_ssize_t hop = index < 0.0 ? 0 : index < line->count - 2 ? (Py_ssize_t)index : line->count - 2;
    return stations[hop] + (index - hop) * (stations[hop + 1] - stations[hop]);
}

typedef struct {
    double throttle, brake;
} Pedals;

static Pedals choose_pedals(double speed, double distance, const Vehicle *vehicle, bool *is_refused) {
    if (distance < 0.1 && speed < 0.1) return (Pedals){0.0, HOLD};
    double acceleration = 2 * (distance - speed * PREVIEW_S) / (PREVIEW_S * PREVIEW_S);
    if (2 * distance < speed * PREVIEW_S) acceleration = -speed * speed / (2 * greatest(0.01, distance));
    double wanted = acceleration + COASTING;
    if (acceleration > -COASTING)
        return (Pedals){divide(greatest(wanted, 0.0), vehicle->max_acceleration, is_refused), 0.0};
    return (Pedals){0.0, divide(-wanted, vehicle->max_deceleration, is_refused)};
}

static double choose_steer(const Line *line, double here, const OwnMotion *own, const Vehicle *vehicle,
                           bool *is_refused) {
    double speed = fabs(own->speed);
    double target = here + LOOK_AHEAD_M + LOOK_AHEAD_S * speed + LOOK_AHEAD_S2 * speed * speed;
    Py_ssize_t behind = 0, beyond = line->hop_count; /* as bisect */
    while (behind < beyond) {
        Py_ssize_t middle = (behind + beyond) / 2;
        if (target < line->hops[middle].start) beyond = middle;
        else behind = middle + 1;
    }
    Hop hop = line->hops[behind > 1 ? behind - 1 : 0];
    CosSin ahead = cos_sin(own->yaw);
    if (!isfinite(ahead.cos)) *is_refused = true;
    Point aim =
        point_to_ego_frame(hop.x + (target - hop.start) * hop.ux, hop.y + (target - hop.start) * hop.uy, ahead, own);
    double rear = vehicle->rear_to_centre, x = aim.x + rear, y = aim.y;
    double curvature = 2 * y / greatest(1e-3, x * x + y * y - rear * rear);
    double angle = portable_atan(vehicle->wheelbase * curvature);
    if (isnan(angle)) *is_refused = true;
    return divide(angle, vehicle->max_steer_angle, is_refused);
}

static PyObject *answer(const Plan *plan, const OwnMotion *own, Py_ssize_t age_ticks, const Vehicle *vehicle,
                        Line *line) {
    bool is_refused = false;
    OwnMotion soon = predict_motion(own, &is_refused);
    build_line(plan, own, age_ticks * TICK_S, line, &is_refused);
    double here = project_on_line(line, soon.x, soon.y);
    double goal = find_station(line, plan->interval_s, age_ticks * TICK_S, &is_refused);
    Pedals pedals = choose_pedals(soon.speed, goal - here, vehicle, &is_refused);
    double steer = choose_steer(line, here, &soon, vehicle, &is_refused);
    return is_refused ? refuse_numbers("follow_plan") : build_control(pedals.throttle, pedals.brake, steer);
}

static PyObject *vehicle_control_tracker_follow_plan(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Plan plan;
    OwnMotion own;
    Vehicle vehicle;
    Py_ssize_t age_ticks;
    if (!expect_arguments("follow_plan", count, 4, 4) || !read_own_motion(arguments[1], &own) ||
        !read_integer(arguments[2], &age_ticks) || !read_fields(arguments[3], &VEHICLE_FIELDS, (double *)&vehicle) ||
        !open_plan(arguments[0], &plan))
        return NULL;
    Py_ssize_t points = plan.points.shape[0];
    Line line = {malloc(points * sizeof *line.stations), malloc(points * sizeof *line.hops), 0, 0};
    PyObject *control =
        line.stations && line.hops ? answer(&plan, &own, age_ticks, &vehicle, &line) : PyErr_NoMemory();
    free(line.stations);
    free(line.hops);
    close_array(&plan.points);
    return control;
}

Functions vehicle_control_tracker = {
    FUNCTION(vehicle_control_tracker_follow_plan),
    END_OF_FUNCTIONS,
};
