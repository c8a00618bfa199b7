// Gamepads and wheels (Gamepad API). A calibration says which axis or button does what, and where it rests and ends, so inverted axes
// and combined pedals (two directions of one axis) need nothing else. It is kept in the browser, by the device's name.

const STORED = "mdrive-sumo drive calibration "; // + name of the device
const STANDARD = {
  steer: { axis: 0, left: -1, centre: 0, right: 1 },
  throttle: { button: 7, rest: 0, full: 1 },
  brake: { button: 6, rest: 0, full: 1 },
  deadZone: 0.08,
  linearity: 1.6,
};
const WHEEL_DEFAULTS = { deadZone: 0, linearity: 1 };
const TOUCHED = 0.05; // change of an axis or pedal that means: somebody uses it

/** The value of a channel {axis} or {button}. Throws an Error with a sentence for what is no number. */
function readChannel(pad, { axis, button }) {
  const value = button === undefined ? pad.axes[axis] : pad.buttons[button]?.value;
  const name = button === undefined ? `axis ${axis}` : `button ${button}`;
  if (value === undefined) throw new Error(`${padName(pad)} has no ${name}: calibrate it anew in the settings.`);
  if (!Number.isFinite(value)) throw new Error(`${padName(pad)}: ${name} gives no number.`);
  return value;
}

function padName(pad) {
  return pad.id.replace(/\s*\(.*\)\s*$/, "").slice(0, 60) || "The gamepad";
}

/** Share of a pedal's way, in [0, 1]. */
function readPedal(pad, channel) {
  const share = (readChannel(pad, channel) - channel.rest) / (channel.full - channel.rest);
  return Math.min(1, Math.max(0, (share - 0.02) / 0.96)); // two hundredths at both ends: pedals rest and end unevenly
}

/** Steering in [-1, 1], left positive, with dead zone and linearity (the exponent; 1: proportional). */
function readSteer(pad, { steer, deadZone, linearity }) {
  const value = readChannel(pad, steer) - steer.centre;
  const end = Math.sign(value) === Math.sign(steer.left - steer.centre) ? steer.left : steer.right;
  const share = Math.min(1, Math.abs(value / (end - steer.centre)));
  const size = Math.max(0, (share - deadZone) / (1 - deadZone)) ** linearity;
  return end === steer.left ? size : -size;
}

function readCalibrated(pad, calibration) {
  return {
    throttle: readPedal(pad, calibration.throttle),
    brake: readPedal(pad, calibration.brake),
    steer: readSteer(pad, calibration),
  };
}

/** The stored calibration of a device; that of a standard gamepad; undefined for a wheel that was never calibrated. */
function loadCalibration(pad) {
  try {
    const stored = JSON.parse(localStorage.getItem(STORED + pad.id));
    if (stored && isCalibration(stored)) return stored;
  } catch {
    // what is stored is not ours, or the browser stores nothing: as if nothing were stored
  }
  return pad.mapping === "standard" ? STANDARD : undefined;
}

function storeCalibration(pad, calibration) {
  try {
    localStorage.setItem(STORED + pad.id, JSON.stringify(calibration));
    return true;
  } catch {
    return false; // a private window: it counts until the page is closed
  }
}

function isCalibration({ steer, throttle, brake, deadZone, linearity }) {
  const isChannel = (channel, ends) =>
    channel && (Number.isInteger(channel.axis) || Number.isInteger(channel.button)) && ends.every((end) => Number.isFinite(channel[end]));
  const spans = [steer?.left - steer?.centre, steer?.right - steer?.centre, throttle?.full - throttle?.rest, brake?.full - brake?.rest];
  return isChannel(steer, ["left", "centre", "right"]) && isChannel(throttle, ["rest", "full"]) && isChannel(brake, ["rest", "full"])
    && spans.every((span) => Math.abs(span) > 0.05) && deadZone >= 0 && deadZone < 0.5 && linearity >= 0.5 && linearity <= 3;
}

class GamepadInput {
  constructor(tell) {
    this.tell = tell; // shows a sentence
    this.calibrations = new Map();
    this.refused = new Set(); // devices of which the person was told
    this.rest = undefined;
    addEventListener("gamepadconnected", ({ gamepad }) => this.greet(gamepad));
  }

  greet(pad) {
    if (loadCalibration(pad)) this.tell(`${padName(pad)} is connected: move it, and it drives.`);
  }

  get device() {
    return this.pad?.mapping === "standard" ? "gamepad" : "wheel";
  }

  /** The control of the chosen device, or undefined if there is none that works. */
  read() {
    const pads = [...(navigator.getGamepads?.() ?? [])].filter((pad) => pad?.connected);
    const pad = pads.find(({ index }) => index === this.pad?.index) ?? pads[0];
    if (this.pad && !pad) this.lose(`${padName(this.pad)} is gone.`);
    this.pad = pad;
    if (!pad || this.refused.has(pad.id)) return undefined;
    const calibration = this.calibrationOf(pad);
    if (!calibration) return this.refuse(pad, `${padName(pad)} is not calibrated: open the settings and follow the steps.`);
    try {
      return readCalibrated(pad, calibration);
    } catch (error) {
      return this.refuse(pad, error.message);
    }
  }

  calibrationOf(pad) {
    if (!this.calibrations.has(pad.id)) this.calibrations.set(pad.id, loadCalibration(pad));
    return this.calibrations.get(pad.id);
  }

  calibrate(pad, calibration) {
    this.calibrations.set(pad.id, calibration);
    this.refused.delete(pad.id);
    return storeCalibration(pad, calibration);
  }

  /** Whether somebody uses the device: what it says differs from when it was last asked. */
  isTouched(control) {
    const before = this.rest;
    if (!before || Object.keys(control).some((name) => Math.abs(control[name] - before[name]) > TOUCHED)) {
      this.rest = control;
      return Boolean(before);
    }
    return false;
  }

  refuse(pad, sentence) {
    this.refused.add(pad.id);
    this.lose(sentence);
    return undefined;
  }

  lose(sentence) {
    this.rest = undefined;
    this.tell(`${sentence} The keyboard drives.`);
  }
}
