"""Vehicle dynamics of a CAV: a single-track model with tyre slip and actuator lags.

The model is the linear single-track model (Riekert and Schunck 1940; Rajamani, Vehicle Dynamics and Control,
ch. 2) with three additions: axle forces are limited by friction; slip angles are taken against at least
`SLIP_SPEED`, so that at walking pace the model becomes the kinematic one instead of dividing by zero; pedals
and wheel answer with a first-order lag. No load transfer, no gears. State in, new state out: `step` is pure.
It integrates by leapfrog (Störmer-Verlet; Hairer, Lubich and Wanner 2003) with tyre forces taken at mid sub-step.
"""

import math
from dataclasses import dataclass

from mdrive_sumo.contract import Control, VehicleFacts
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.core.state import DT, EgoState

Triple = tuple[float, float, float]
GRAVITY = 9.81
"""[m/s2]"""
AIR_DENSITY = 1.2
"""[kg/m3] At 20 °C and sea level."""
SUB_STEPS = 5
"""Sub-steps of a tick, 10 ms each. Measured on 31 drives of 8 s with hard swerving (64 to 108 m): the path ends within
0.05 m (median 0.01 m) of the converged one."""
SLIP_SPEED = 3.0
"""Least speed [m/s] that slip angles are taken against."""


@dataclass(frozen=True, slots=True)
class VehicleParameters:
    """Parameters of a car. SI units; the centre of gravity is the centre of the box.

    The defaults are the paper's car, a Lincoln MKZ 2017 (`vehicle.lincoln.mkz2017` in CARLA). "Apollo" is the
    public calibration of that car in Baidu Apollo (data set `mkz_example`, lateral controller).
    """

    length: float = 4.90
    """Twice the half extent 2.45 m that the original benchmark uses (spec/protocol.md, section 16)."""
    width: float = 2.00
    """Twice the half extent 1.00 m, as `length`."""
    wheelbase: float = 2.845
    """Apollo: 2.8448 m."""
    rear_to_centre: float = 1.4225
    """Half the wheelbase: Apollo has equal corner masses and its box centre 1.42 m before the rear axle."""
    mass: float = 2080.0
    """Apollo: four corners of 520 kg (with passengers and equipment)."""
    yaw_inertia: float = 4210.0
    """Apollo's rule: mass x (distance to front axle) x (distance to rear axle)."""
    front_stiffness: float = 155_495.0
    """Cornering stiffness of the front axle [N/rad], Apollo."""
    rear_stiffness: float = 155_495.0
    """Cornering stiffness of the rear axle [N/rad], Apollo; as the front's, so the car steers neutrally."""
    friction: float = 0.9
    """Tyre friction on a dry road. Assumption: dry asphalt."""
    grip: float = 1.0
    """Share of that friction which the road gives; also of the greatest brake and drive force, which tyres carry."""
    max_steer_angle: float = 0.75
    """Front wheels at full lock [rad]. Assumption within one source: the bicycle model that Chen et al. (World
    on Rails, ICCV 2021) fitted to data of this car in CARLA has the curvature of 0.79 rad for small inputs
    and of 0.65 rad at full lock. The real car reaches 0.51 rad (Apollo), CARLA's inner wheel 1.22 rad."""
    max_steer_rate: float = 0.9
    """[rad/s]. Assumption: a fast hand, 800 deg/s at the wheel, ratio 16; Apollo allows itself 0.44."""
    steer_lag: float = 0.08
    """Time constant of the steering [s]. Assumption."""
    max_power: float = 155_000.0
    """Power at the wheels [W]: the 183 kW (245 hp) of the 2.0 l engine less 15 % driveline losses (assumed)."""
    max_acceleration: float = 4.5
    """Limit of the drive force, as acceleration [m/s2]. Assumption; 0-100 km/h then takes 7.65 s."""
    max_speed: float = 58.0
    """Governed top speed [m/s]. Assumption: 130 mph."""
    max_deceleration: float = 8.0
    """Deceleration at full brake [m/s2], a little under the friction limit 0.9 g. Assumption: anti-lock brakes."""
    drive_lag: float = 0.25
    """Time constant from throttle to force [s]. Assumption."""
    brake_lag: float = 0.12
    """Time constant from brake pedal to force [s]. Assumption: hydraulic brakes reach 90 % in under 0.3 s."""
    rolling_resistance: float = 0.012
    """Share of the weight. Assumption: textbook value for a car tyre on asphalt."""
    drag_area: float = 0.68
    """Drag coefficient x frontal area [m2]. Assumption: 0.30 (CARLA's blueprint value) x 2.27 m2."""


MKZ_2017 = VehicleParameters()


@dataclass(frozen=True, slots=True)
class VehicleState:
    """The complete state of a moving car: pose of the box centre, velocity in the car's own frame, actuators."""

    x: float
    y: float
    yaw: float
    vx: float = 0.0
    """Forward speed of the box centre [m/s]."""
    vy: float = 0.0
    """Leftward speed of the box centre [m/s]."""
    yaw_rate: float = 0.0
    steer_angle: float = 0.0
    """Front wheels [rad], left positive."""
    drive: float = 0.0
    """Share of the drive force that is there, [0, 1]; follows the throttle."""
    brake: float = 0.0
    """Share of the brake force that is there, [0, 1]; follows the pedal."""
    acceleration: float = 0.0
    """Mean change of vx in the last tick [m/s2]."""


def initial_state(x: float, y: float, yaw: float, speed: float = 0.0) -> VehicleState:
    """Return a car at that pose [m, m, rad] that rolls straight ahead at `speed` [m/s], with pedals released."""
    return VehicleState(x, y, wrap_angle(yaw), vx=speed)


@twin
def to_ego_state(body: VehicleState, /) -> EgoState:
    """Return the externally visible state; speed is signed, along yaw."""
    return EgoState(body.x, body.y, body.yaw, body.vx, body.acceleration, body.yaw_rate, body.steer_angle)


def to_vehicle_facts(vehicle: VehicleParameters) -> VehicleFacts:
    """Return the facts about the car that an agent gets in its briefing."""
    return VehicleFacts(
        length=vehicle.length,
        width=vehicle.width,
        wheelbase=vehicle.wheelbase,
        rear_to_centre=vehicle.rear_to_centre,
        mass=vehicle.mass,
        max_steer_angle=vehicle.max_steer_angle,
        max_speed=vehicle.max_speed,
        max_acceleration=vehicle.max_acceleration,
        max_deceleration=vehicle.max_deceleration,
    )


@twin
def step(
    body: VehicleState, control: Control, vehicle: VehicleParameters, sub_steps: int = SUB_STEPS, /
) -> VehicleState:
    """Return the state of the next tick under a constant control.

    There is no reverse gear: only an external impulse makes vx negative, and a standing car without throttle stays
    exactly where it is.
    """
    h = DT / sub_steps
    x, y, yaw, steer_angle, drive, brake = body.x, body.y, body.yaw, body.steer_angle, body.drive, body.brake
    target, most_turn = control.steer * vehicle.max_steer_angle, vehicle.max_steer_rate * h
    pedal = min(control.brake, vehicle.grip)  # anti-lock brakes
    # The shares of their ways that steering, drive and brake go in a sub-step.
    turned, pressed, clamped = (
        -portable.expm1(-h / lag) for lag in (vehicle.steer_lag, vehicle.drive_lag, vehicle.brake_lag)
    )
    cos, sin = portable.cos_sin(yaw)
    # Velocity in the world frame, so that a turning car needs no Coriolis terms.
    u, v, yaw_rate = cos * body.vx - sin * body.vy, sin * body.vx + cos * body.vy, body.yaw_rate
    for _ in range(sub_steps):
        # Leapfrog: half a sub-step of motion, the forces there with the actuators' mean, the other half of motion.
        turn = _clamp(most_turn, (target - steer_angle) * turned)
        press, clamp = (control.throttle - drive) * pressed, (pedal - brake) * clamped
        x, y, yaw = x + h / 2 * u, y + h / 2 * v, yaw + h / 2 * yaw_rate
        cos, sin = portable.cos_sin(yaw)
        motion = cos * u + sin * v, cos * v - sin * u, yaw_rate
        vx, vy, yaw_rate = _apply_forces(
            motion, steer_angle + turn / 2, drive + press / 2, brake + clamp / 2, vehicle, h
        )
        u, v = cos * vx - sin * vy, sin * vx + cos * vy
        x, y, yaw = x + h / 2 * u, y + h / 2 * v, yaw + h / 2 * yaw_rate
        steer_angle, drive, brake = steer_angle + turn, drive + press, brake + clamp
    cos, sin = portable.cos_sin(yaw)
    vx, vy = cos * u + sin * v, cos * v - sin * u
    if abs(vx) + abs(vy) + abs(yaw_rate) < 1e-3:  # static friction of standing tyres
        vx = vy = yaw_rate = 0.0
    return VehicleState(x, y, wrap_angle(yaw), vx, vy, yaw_rate, steer_angle, drive, brake, (vx - body.vx) / DT)


def _clamp(limit: float, value: float) -> float:
    """Return the value clamped to +-limit."""
    return max(min(value, limit), -limit)


def _apply_forces(
    motion: Triple, steer_angle: float, drive: float, brake: float, vehicle: VehicleParameters, h: float
) -> Triple:
    """Motion (vx, vy, yaw rate) after all forces have acted for h seconds, in the same frame."""
    grip = _compute_lateral_limit(motion[0], drive, brake, vehicle)
    vx, vy, yaw_rate = _apply_lateral_forces(motion, steer_angle, grip, vehicle, h)
    return _apply_longitudinal_forces(vx, drive, brake, vehicle, h), vy, yaw_rate


def _compute_lateral_limit(vx: float, drive: float, brake: float, vehicle: VehicleParameters) -> float:
    """Lateral acceleration [m/s2] that tyres can give while they drive or brake (friction circle)."""
    braking = brake * vehicle.max_deceleration
    used = drive * vehicle.max_acceleration + (braking if vx < 0.0 else -braking)
    left = portable.square(vehicle.friction * vehicle.grip * GRAVITY) - used * used
    return math.sqrt(left) if left > 0.0 else 0.0


def _apply_lateral_forces(
    motion: Triple, steer_angle: float, grip: float, vehicle: VehicleParameters, h: float
) -> Triple:
    """Motion after the lateral forces of both axles have acted for h seconds."""
    vx, vy, yaw_rate = motion
    mass, inertia, b = vehicle.mass, vehicle.yaw_inertia, vehicle.rear_to_centre
    a = vehicle.wheelbase - b
    cos, sin = portable.cos_sin(steer_angle)
    sideways = vy + a * yaw_rate
    rolling, sliding = vx * cos + sideways * sin, sideways * cos - vx * sin
    press = grip * mass / vehicle.wheelbase
    # An axle's own sliding dies with the time constant of the mass that it sees: 1 / mass + lever^2 / inertia.
    front = _axle_force(rolling, sliding, vehicle.front_stiffness, h * (1 / mass + a * a / inertia), press * b)
    rear = _axle_force(vx, vy - b * yaw_rate, vehicle.rear_stiffness, h * (1 / mass + b * b / inertia), press * a)
    return (
        vx - h * front * sin / mass,
        vy + h * (front * cos + rear) / mass,
        yaw_rate + h * (a * front * cos - b * rear) / inertia,
    )


def _axle_force(rolling: float, sliding: float, stiffness: float, response: float, limit: float) -> float:
    """Mean lateral force [N] of an axle that rolls and slides with these speeds [m/s]; it opposes the sliding.

    `response` [m/s/N] is how much slower each newton makes it slide by the end of the sub-step: the force is the one
    in the middle (linearly implicit midpoint rule), which is of second order and stable for any sub-step.
    """
    rolling = max(abs(rolling), SLIP_SPEED)
    force = -stiffness * portable.atan(sliding / rolling) / (1 + stiffness * response / (2 * rolling))
    return _clamp(limit, force)


def _apply_longitudinal_forces(vx: float, drive: float, brake: float, vehicle: VehicleParameters, h: float) -> float:
    """Forward speed after engine, air, brake and rolling resistance have acted for h seconds."""
    power = vehicle.max_power / vehicle.mass
    most = vehicle.max_acceleration if vx * vehicle.max_acceleration < power else power / vx
    spare = vehicle.max_speed - vx
    if spare < 1.0:  # governor
        most *= max(0.0, spare)
    pull, limit = drive * most, vehicle.grip * vehicle.max_acceleration
    pull = min(pull, limit)  # traction control
    vx += h * (pull - 0.5 * AIR_DENSITY * vehicle.drag_area * vx * abs(vx) / vehicle.mass)
    # Resistance can stop a car but never reverse it.
    resisted = h * (brake * vehicle.max_deceleration + vehicle.rolling_resistance * GRAVITY)
    return vx - math.copysign(resisted, vx) if abs(vx) > resisted else 0.0
