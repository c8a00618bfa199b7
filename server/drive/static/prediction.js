// The own car, shown before the simulation answers (decision 080). Time is counted in inputs: input n is one tick.
//
// From the last state that the simulation has acknowledged, the vehicle model drives the inputs that are still on their
// way, and for what has passed of the current tick the control of this moment. So a key acts in the next picture.
// What counts is the simulation's state: where it differs, the picture is moved there within some tenths of a second.

const CORRECTION_S = 0.12; // time constant with which a correction fades in
const CLOCK_S = 0.5; // time constant with which the shown time follows the inputs, whose frames arrive unevenly
const JUMP_M = 6; // a larger correction is a jump (a rewind, a collision): it is shown at once
const JUMP_TICKS = 6; // the same for time
const MOST_AHEAD = 3; // ticks: if no input is due for longer, the simulation has stopped, and so does the picture

class Prediction {
  constructor(vehicle) {
    this.vehicle = vehicle;
    this.forget();
  }

  /** Starts anew (another take, a rewind) after input `number`. */
  forget(number = 0) {
    this.states = []; // [0]: acknowledged; [i]: after i more inputs
    this.inputs = []; // {number, control}, numbered without gaps, not acknowledged yet
    this.acknowledged = number;
    this.shown = undefined; // time of the picture, in inputs
    this.live = undefined; // the control of this moment
    this.error = { x: 0, y: 0, yaw: 0 };
  }

  get ready() {
    return this.states.length > 0;
  }

  get waiting() {
    return this.inputs.length;
  }

  /** Number of the newest input that is part of the prediction. */
  get newest() {
    return this.acknowledged + this.inputs.length;
  }

  /** The predicted state after all inputs. */
  get head() {
    return this.states.at(-1);
  }

  /** Applies the next input, which is on its way. */
  apply(number, control) {
    this.inputs.push({ number, control });
    this.states.push(stepVehicle(this.head, control, this.vehicle));
  }

  /** Takes over the state of a frame, in which input `ack` was the newest used (0: none yet); repeats those after it. */
  acknowledge(ack, state) {
    const before = this.shown === undefined ? undefined : this.poseAt(this.shown);
    this.acknowledged = Math.max(this.acknowledged, ack);
    this.inputs = this.inputs.filter(({ number }) => number > this.acknowledged);
    this.states = [state];
    for (const { control } of this.inputs) this.states.push(stepVehicle(this.head, control, this.vehicle));
    if (before) this.smooth(before, this.poseAt(this.shown));
  }

  smooth(before, after) {
    const apart = Math.hypot(before.x - after.x, before.y - after.y);
    if (apart + Math.hypot(this.error.x, this.error.y) > JUMP_M) {
      this.error = { x: 0, y: 0, yaw: 0 };
      return;
    }
    this.error.x += before.x - after.x;
    this.error.y += before.y - after.y;
    this.error.yaw = wrapAngle(this.error.yaw + before.yaw - after.yaw);
  }

  /**
   * Moves the time of the picture on: `sinceInput` ticks have passed since the newest input, `ticks` since the last call, `elapsed` [s].
   */
  advance(sinceInput, ticks, elapsed) {
    const target = this.newest + Math.min(sinceInput, MOST_AHEAD);
    if (this.shown === undefined || Math.abs(target - this.shown) > JUMP_TICKS) this.shown = target;
    else {
      const next = this.shown + (sinceInput < MOST_AHEAD ? ticks : 0);
      this.shown = Math.max(this.shown, next + (target - next) * -Math.expm1(-elapsed / CLOCK_S));
    }
    this.shown = Math.min(Math.max(this.shown, this.acknowledged), this.newest + MOST_AHEAD);
    const kept = Math.exp(-elapsed / CORRECTION_S);
    for (const key of ["x", "y", "yaw"]) this.error[key] *= kept;
  }

  /** The state of the picture: predicted, plus what is left of the last corrections. `live`: the control of this moment. */
  picture(live) {
    const state = this.poseAt(this.shown ?? this.newest, live);
    return { ...state, x: state.x + this.error.x, y: state.y + this.error.y, yaw: wrapAngle(state.yaw + this.error.yaw) };
  }

  /** The predicted state at a time in inputs; beyond the newest one, the `live` control acts. */
  poseAt(time, live) {
    const index = Math.min(Math.floor(time - this.acknowledged), this.states.length - 1);
    if (index < 0) return this.states[0];
    const share = time - this.acknowledged - index;
    if (index + 1 < this.states.length) return mixStates(this.states[index], this.states[index + 1], share);
    if (share <= 0) return this.states[index];
    this.live = live ?? this.live;
    return this.live ? stepVehicle(this.states[index], this.live, this.vehicle, share * TICK_S) : this.states[index];
  }
}

/** Between two neighbouring ticks; the yaw turns the short way. */
function mixStates(a, b, share) {
  const mixed = {};
  for (const name of STATE_FIELDS) mixed[name] = a[name] + (b[name] - a[name]) * share;
  mixed.yaw = wrapAngle(a.yaw + wrapAngle(b.yaw - a.yaw) * share);
  return mixed;
}
