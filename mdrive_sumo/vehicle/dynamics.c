/* Twins of dynamics.py: how a car moves in a tick. */
#include "dynamics.h"

#include "../core/portable.h"

static Import VEHICLE_STATE = {"mdrive_sumo.vehicle.dynamics", "VehicleState", 0},
              EGO_STATE = {"mdrive_sumo.core.state", "EgoState", 0};
FIELDS(STATE_FIELDS, "x", "y", "yaw", "vx", "vy", "yaw_rate", "steer_angle", "drive", "brake", "acceleration");
FIELDS(EGO_FIELDS, "x", "y", "yaw", "speed", "acceleration", "yaw_rate", "steer_angle");
FIELDS(SHOWN_FIELDS, "x", "y", "yaw", "vx", "acceleration", "yaw_rate", "steer_angle");
FIELDS(CONTROL_FIELDS, "throttle", "brake", "steer");
FIELDS(VEHICLE_FIELDS, "wheelbase", "rear_to_centre", "mass", "yaw_inertia", "front_stiffness", "rear_stiffness",
       "friction", "grip", "max_steer_angle", "max_steer_rate", "steer_lag", "max_power", "max_acceleration",
       "max_speed", "max_deceleration", "drive_lag", "brake_lag", "rolling_resistance", "drag_area");

typedef struct {
    double throttle, brake, steer;
} Control;
typedef struct {
    double wheelbase, rear_to_centre, mass, yaw_inertia, front_stiffness, rear_stiffness, friction, grip,
        max_steer_angle, max_steer_rate, steer_lag, max_power, max_acceleration, max_speed, max_deceleration, drive_lag,
        brake_lag, rolling_resistance, drag_area;
} Vehicle;
typedef struct {
    double vx, vy, yaw_rate;
} Motion;

static const double GRAVITY = 9.81, AIR_DENSITY = 1.2, SLIP_SPEED = 3.0, TICK_S = 1.0 / 20;
enum { SUB_STEPS = 5 };

bool read_vehicle_state(PyObject *object, VehicleState *state) {
    return read_fields(object, &STATE_FIELDS, (double *)state);
}

PyObject *build_vehicle_state(const VehicleState *state) {
    return build_instance_of_numbers(&VEHICLE_STATE, &STATE_FIELDS, (const double *)state);
}

static PyObject *vehicle_dynamics_to_ego_state(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("to_ego_state", count, 1, 1)) return NULL;
    PyObject *values[MOST_FIELDS];
    for (int i = 0; i < SHOWN_FIELDS.count; i++) values[i] = get_field(arguments[0], &SHOWN_FIELDS, i);
    return build_instance(&EGO_STATE, &EGO_FIELDS, values);
}

static double clamp_to(double limit, double value) {
    double low = limit < value ? limit : value;
    return -limit > low ? -limit : low;
}

static double compute_lateral_limit(double vx, double drive, double brake, const Vehicle *vehicle) {
    double braking = brake * vehicle->max_deceleration;
    double used = drive * vehicle->max_acceleration + (vx < 0.0 ? braking : -braking);
    double most = vehicle->friction * vehicle->grip * GRAVITY, left = most * most - used * used;
    return left > 0.0 ? sqrt(left) : 0.0;
}

static double axle_force(double rolling, double sliding, double stiffness, double response, double limit,
                         bool *is_refused) {
    rolling = SLIP_SPEED > fabs(rolling) ? SLIP_SPEED : fabs(rolling);
    double slip = portable_atan(sliding / rolling);
    if (isnan(slip)) *is_refused = true;
    return clamp_to(limit, divide(-stiffness * slip, 1 + stiffness * response / (2 * rolling), is_refused));
}

static Motion apply_lateral_forces(Motion motion, double steer_angle, double grip, const Vehicle *vehicle, double h,
                                   bool *is_refused) {
    double vx = motion.vx, vy = motion.vy, yaw_rate = motion.yaw_rate;
    double mass = vehicle->mass, inertia = vehicle->yaw_inertia, b = vehicle->rear_to_centre;
    double a = vehicle->wheelbase - b;
    CosSin wheel = cos_sin(steer_angle);
    if (!isfinite(wheel.cos) || mass == 0.0 || inertia == 0.0) *is_refused = true;
    double sideways = vy + a * yaw_rate;
    double rolling = vx * wheel.cos + sideways * wheel.sin, sliding = sideways * wheel.cos - vx * wheel.sin;
    double press = divide(grip * mass, vehicle->wheelbase, is_refused);
    double front = axle_force(rolling, sliding, vehicle->front_stiffness, h * (1 / mass + a * a / inertia), press * b,
                              is_refused);
    double rear = axle_force(vx, vy - b * yaw_rate, vehicle->rear_stiffness, h * (1 / mass + b * b / inertia),
                             press * a, is_refused);
    return (Motion){vx - h * front * wheel.sin / mass, vy + h * (front * wheel.cos + rear) / mass,
                    yaw_rate + h * (a * front * wheel.cos - b * rear) / inertia};
}

static double apply_longitudinal_forces(double vx, double drive, double brake, const Vehicle *vehicle, double h,
                                        bool *is_refused) {
    double power = vehicle->max_power / vehicle->mass;
    double most = vehicle->max_acceleration;
    if (!(vx * vehicle->max_acceleration < power)) most = divide(power, vx, is_refused);
    double spare = vehicle->max_speed - vx;
    if (spare < 1.0) most *= spare > 0.0 ? spare : 0.0;
    double pull = drive * most, limit = vehicle->grip * vehicle->max_acceleration;
    pull = limit < pull ? limit : pull;
    vx += h * (pull - 0.5 * AIR_DENSITY * vehicle->drag_area * vx * fabs(vx) / vehicle->mass);
    double resisted = h * (brake * vehicle->max_deceleration + vehicle->rolling_resistance * GRAVITY);
    return fabs(vx) > resisted ? vx - copysign(resisted, vx) : 0.0;
}

static Motion apply_forces(Motion motion, double steer_angle, double drive, double brake, const Vehicle *vehicle,
                           double h, bool *is_refused) {
    double grip = compute_lateral_limit(motion.vx, drive, brake, vehicle);
    Motion next = apply_lateral_forces(motion, steer_angle, grip, vehicle, h, is_refused);
    next.vx = apply_longitudinal_forces(next.vx, drive, brake, vehicle, h, is_refused);
    return next;
}

static double compute_share(double h, double lag, bool *is_refused) {
    double share = -portable_expm1(divide(-h, lag, is_refused));
    if (!isfinite(share)) *is_refused = true;
    return share;
}

static VehicleState step(VehicleState body, Control control, const Vehicle *vehicle, Py_ssize_t sub_steps,
                         bool *is_refused) {
    double h = divide(TICK_S, sub_steps, is_refused), vx_before = body.vx;
    double target = control.steer * vehicle->max_steer_angle, most_turn = vehicle->max_steer_rate * h;
    double pedal = vehicle->grip < control.brake ? vehicle->grip : control.brake;
    double turned = compute_share(h, vehicle->steer_lag, is_refused);
    double pressed = compute_share(h, vehicle->drive_lag, is_refused);
    double clamped = compute_share(h, vehicle->brake_lag, is_refused);
    CosSin ahead = cos_sin(body.yaw);
    double u = ahead.cos * body.vx - ahead.sin * body.vy, v = ahead.sin * body.vx + ahead.cos * body.vy;
    for (Py_ssize_t i = 0; i < sub_steps && !*is_refused; i++) {
        double turn = clamp_to(most_turn, (target - body.steer_angle) * turned);
        double press = (control.throttle - body.drive) * pressed, clamp = (pedal - body.brake) * clamped;
        body.x = body.x + h / 2 * u, body.y = body.y + h / 2 * v, body.yaw = body.yaw + h / 2 * body.yaw_rate;
        ahead = cos_sin(body.yaw);
        if (!isfinite(ahead.cos)) *is_refused = true;
        Motion motion = {ahead.cos * u + ahead.sin * v, ahead.cos * v - ahead.sin * u, body.yaw_rate};
        motion = apply_forces(motion, body.steer_angle + turn / 2, body.drive + press / 2, body.brake + clamp / 2,
                              vehicle, h, is_refused);
        u = ahead.cos * motion.vx - ahead.sin * motion.vy, v = ahead.sin * motion.vx + ahead.cos * motion.vy;
        body.yaw_rate = motion.yaw_rate;
        body.x = body.x + h / 2 * u, body.y = body.y + h / 2 * v, body.yaw = body.yaw + h / 2 * body.yaw_rate;
        body.steer_angle += turn, body.drive += press, body.brake += clamp;
    }
    ahead = cos_sin(body.yaw);
    if (!isfinite(ahead.cos)) *is_refused = true;
    body.vx = ahead.cos * u + ahead.sin * v, body.vy = ahead.cos * v - ahead.sin * u;
    if (fabs(body.vx) + fabs(body.vy) + fabs(body.yaw_rate) < 1e-3) body.vx = body.vy = body.yaw_rate = 0.0;
    body.yaw = wrap_angle(body.yaw);
    body.acceleration = (body.vx - vx_before) / TICK_S;
    return body;
}

static PyObject *vehicle_dynamics_step(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    VehicleState body;
    Control control;
    Vehicle vehicle;
    Py_ssize_t sub_steps = SUB_STEPS;
    if (!expect_arguments("step", count, 3, 4) || !read_vehicle_state(arguments[0], &body) ||
        !read_fields(arguments[1], &CONTROL_FIELDS, (double *)&control) ||
        !read_fields(arguments[2], &VEHICLE_FIELDS, (double *)&vehicle) ||
        (count == 4 && !read_integer(arguments[3], &sub_steps)))
        return NULL;
    bool is_refused = false;
    VehicleState after = step(body, control, &vehicle, sub_steps, &is_refused);
    return is_refused ? refuse_numbers("step") : build_vehicle_state(&after);
}

Functions vehicle_dynamics = {
    FUNCTION(vehicle_dynamics_to_ego_state),
    FUNCTION(vehicle_dynamics_step),
    END_OF_FUNCTIONS,
};
