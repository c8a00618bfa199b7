// The vehicle model of the simulation, `mdrive_sumo.vehicle.dynamics.step`, for prediction in the browser. A test drives
// both. Sine, arc tangent and exponential are the browser's: they differ from the simulation's in the last digits.

const TICK_S = 0.05;
const SUB_STEPS = 5;
const SLIP_SPEED = 3; // m/s, the least speed that slip angles are taken against
const GRAVITY = 9.81; // m/s2
const AIR_DENSITY = 1.2; // kg/m3
const STATE_FIELDS = ["x", "y", "yaw", "vx", "vy", "yaw_rate", "steer_angle", "drive", "brake", "acceleration"];

/** The angle wrapped to (-pi, pi]. */
function wrapAngle(angle) {
  const wrapped = angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
  return wrapped <= -Math.PI ? wrapped + 2 * Math.PI : wrapped;
}

function clampTo(limit, value) {
  return Math.max(Math.min(value, limit), -limit);
}

/** The state `seconds` later under a constant control {throttle, brake, steer}; `vehicle`: VehicleParameters. */
function stepVehicle(body, control, vehicle, seconds = TICK_S) {
  const h = seconds / SUB_STEPS;
  let { x, y, yaw, steer_angle, drive, brake } = body;
  const target = control.steer * vehicle.max_steer_angle;
  const mostTurn = vehicle.max_steer_rate * h;
  const pedal = Math.min(control.brake, vehicle.grip);
  const turned = -Math.expm1(-h / vehicle.steer_lag);
  const pressed = -Math.expm1(-h / vehicle.drive_lag);
  const clamped = -Math.expm1(-h / vehicle.brake_lag);
  let [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  let u = cos * body.vx - sin * body.vy; // velocity in the world frame: a turning car needs no Coriolis terms
  let v = sin * body.vx + cos * body.vy;
  let rate = body.yaw_rate;
  for (let i = 0; i < SUB_STEPS; i++) {
    const turn = clampTo(mostTurn, (target - steer_angle) * turned);
    const press = (control.throttle - drive) * pressed;
    const clamp = (pedal - brake) * clamped;
    [x, y, yaw] = [x + (h / 2) * u, y + (h / 2) * v, yaw + (h / 2) * rate];
    [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
    const actuators = [steer_angle + turn / 2, drive + press / 2, brake + clamp / 2];
    const [vx, vy, after] = applyForces([cos * u + sin * v, cos * v - sin * u, rate], actuators, vehicle, h);
    [u, v, rate] = [cos * vx - sin * vy, sin * vx + cos * vy, after];
    [x, y, yaw] = [x + (h / 2) * u, y + (h / 2) * v, yaw + (h / 2) * rate];
    [steer_angle, drive, brake] = [steer_angle + turn, drive + press, brake + clamp];
  }
  [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  let [vx, vy] = [cos * u + sin * v, cos * v - sin * u];
  if (Math.abs(vx) + Math.abs(vy) + Math.abs(rate) < 1e-3) vx = vy = rate = 0; // static friction of standing tyres
  const acceleration = (vx - body.vx) / seconds;
  return { x, y, yaw: wrapAngle(yaw), vx, vy, yaw_rate: rate, steer_angle, drive, brake, acceleration };
}

/** Motion [vx, vy, yaw rate] after all forces have acted for h seconds. */
function applyForces(motion, [steerAngle, drive, brake], vehicle, h) {
  const grip = lateralLimit(motion[0], drive, brake, vehicle);
  const [vx, vy, rate] = applyLateralForces(motion, steerAngle, grip, vehicle, h);
  return [applyLongitudinalForces(vx, drive, brake, vehicle, h), vy, rate];
}

/** Lateral acceleration [m/s2] that tyres can give while they drive or brake (friction circle). */
function lateralLimit(vx, drive, brake, vehicle) {
  const braking = brake * vehicle.max_deceleration;
  const used = drive * vehicle.max_acceleration + (vx < 0 ? braking : -braking);
  const left = (vehicle.friction * vehicle.grip * GRAVITY) ** 2 - used * used;
  return left > 0 ? Math.sqrt(left) : 0;
}

function applyLateralForces([vx, vy, rate], steerAngle, grip, vehicle, h) {
  const { mass, yaw_inertia: inertia, rear_to_centre: b, wheelbase } = vehicle;
  const a = wheelbase - b;
  const [cos, sin] = [Math.cos(steerAngle), Math.sin(steerAngle)];
  const sideways = vy + a * rate;
  const [rolling, sliding] = [vx * cos + sideways * sin, sideways * cos - vx * sin];
  const press = (grip * mass) / wheelbase;
  const front = axleForce(rolling, sliding, vehicle.front_stiffness, h * (1 / mass + (a * a) / inertia), press * b);
  const rear = axleForce(vx, vy - b * rate, vehicle.rear_stiffness, h * (1 / mass + (b * b) / inertia), press * a);
  return [
    vx - (h * front * sin) / mass,
    vy + (h * (front * cos + rear)) / mass,
    rate + (h * (a * front * cos - b * rear)) / inertia,
  ];
}

/** Mean lateral force [N] of an axle (linearly implicit midpoint rule); it opposes the sliding. */
function axleForce(rollingSpeed, sliding, stiffness, response, limit) {
  const rolling = Math.max(Math.abs(rollingSpeed), SLIP_SPEED);
  return clampTo(limit, (-stiffness * Math.atan(sliding / rolling)) / (1 + (stiffness * response) / (2 * rolling)));
}

/** Forward speed after engine, air, brake and rolling resistance have acted for h seconds. */
function applyLongitudinalForces(speed, drive, brake, vehicle, h) {
  const power = vehicle.max_power / vehicle.mass;
  let most = speed * vehicle.max_acceleration < power ? vehicle.max_acceleration : power / speed;
  const spare = vehicle.max_speed - speed;
  if (spare < 1) most *= Math.max(0, spare); // governor
  const pull = Math.min(drive * most, vehicle.grip * vehicle.max_acceleration); // traction control
  const vx = speed + h * (pull - (0.5 * AIR_DENSITY * vehicle.drag_area * speed * Math.abs(speed)) / vehicle.mass);
  const resisted = h * (brake * vehicle.max_deceleration + vehicle.rolling_resistance * GRAVITY);
  return Math.abs(vx) > resisted ? vx - Math.sign(vx) * resisted : 0;
}
