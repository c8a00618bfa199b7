// Driving by keys. Pedals and wheel move at stated rates; the way of the wheel is less at higher speed. The help names the rates.

const KEYS = {
  ArrowUp: "throttle", KeyW: "throttle",
  ArrowDown: "brake", KeyS: "brake",
  ArrowLeft: "left", KeyA: "left",
  ArrowRight: "right", KeyD: "right",
  Space: "stop",
  ShiftLeft: "gentle", ShiftRight: "gentle",
};
const TO_LIMIT_S = 0.5; // from the centre to the limit of the wheel
const TO_CENTRE_S = 0.3; // and back, when no key is pressed
const PEDAL_DOWN_S = 0.4;
const PEDAL_UP_S = 0.1;
const SIDEWAYS_M_S2 = 4; // limit of the wheel: a curve of this lateral acceleration, under half of what dry tyres give
const GENTLE = 0.5; // share of pedals and wheel while Shift is held

/** The largest steering in (0, 1] at a speed [m/s]. */
function steerLimit(speed, vehicle) {
  const angle = Math.atan((vehicle.wheelbase * SIDEWAYS_M_S2) / Math.max(speed * speed, 1));
  return Math.min(1, angle / vehicle.max_steer_angle);
}

class Keyboard {
  constructor() {
    this.device = "keyboard";
    this.held = new Set();
    this.release();
  }

  release() {
    this.held.clear();
    this.control = { throttle: 0, brake: 0, steer: 0 };
  }

  /** Notes a key that goes down or up; true if it drives. */
  press(code, isDown) {
    const action = KEYS[code];
    if (!action) return false;
    if (isDown) this.held.add(code);
    else this.held.delete(code);
    return true;
  }

  does(action) {
    return [...this.held].some((code) => KEYS[code] === action);
  }

  get isSteering() {
    return this.does("left") || this.does("right");
  }

  /** The control after `elapsed` s more. */
  read(elapsed, speed, vehicle) {
    const share = this.does("gentle") ? GENTLE : 1;
    const limit = steerLimit(Math.abs(speed), vehicle) * share;
    const side = (this.does("left") ? 1 : 0) - (this.does("right") ? 1 : 0);
    const way = (elapsed * limit) / (side ? TO_LIMIT_S : TO_CENTRE_S);
    const returns = side && Math.sign(this.control.steer) === -side; // against the pressed side it goes back faster
    const { throttle, brake, steer } = this.control;
    this.control = {
      throttle: approach(throttle, this.does("throttle") ? share : 0, elapsed, PEDAL_DOWN_S, PEDAL_UP_S),
      brake: this.does("stop") ? 1 : approach(brake, this.does("brake") ? share : 0, elapsed, PEDAL_DOWN_S, PEDAL_UP_S),
      steer: clampTo(limit, moveTo(steer, side * limit, returns ? (way * TO_LIMIT_S) / TO_CENTRE_S : way)),
    };
    return this.control;
  }
}

function moveTo(value, target, way) {
  return value + clampTo(way, target - value);
}

function approach(value, target, elapsed, downS, upS) {
  return moveTo(value, target, elapsed / (target > value ? downS : upS));
}
