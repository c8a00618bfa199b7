// Calibration of a gamepad or wheel, step by step, in the settings. What moves most in a step is what the step asks for.

const STEPS = [
  { key: "rest", text: "Let go of everything: wheel straight, pedals up." },
  { key: "left", text: "Turn the wheel, or push the stick, fully to the left and hold it." },
  { key: "right", text: "Now fully to the right and hold it." },
  { key: "throttle", text: "Press the throttle fully and hold it." },
  { key: "brake", text: "Press the brake fully and hold it." },
];
const LEAST_TRAVEL = 0.2; // of an axis whose whole travel is 2

/** All values of a device: axes, then buttons. */
function readValues(pad) {
  return [...pad.axes, ...pad.buttons.map(({ value }) => value)];
}

/** Throws an Error with a sentence if an axis is no number. */
function checkValues(pad, values) {
  const dead = pad.axes.findIndex((value) => !Number.isFinite(value));
  if (dead >= 0) throw new Error(`${padName(pad)}: axis ${dead} gives no number. Calibration needs a device whose axes work.`);
  return values;
}

function channelOf(pad, index) {
  return index < pad.axes.length ? { axis: index } : { button: index - pad.axes.length };
}

/** The value that differs most between two readings. */
function findMoved(before, after, name) {
  const travels = after.map((value, i) => Math.abs(value - before[i]));
  const most = Math.max(...travels);
  if (!(most >= LEAST_TRAVEL)) throw new Error(`Nothing moved for: ${name}. Hold it at its end and press Next.`);
  return travels.indexOf(most);
}

/** The calibration that the readings of all steps tell. Throws an Error with a sentence. */
function buildCalibration(pad, readings) {
  const { rest, left, right, throttle, brake } = readings;
  const wheel = findMoved(left, right, "steering");
  const pedals = { throttle: findMoved(rest, throttle, "throttle"), brake: findMoved(rest, brake, "brake") };
  if (pedals.throttle === wheel || pedals.brake === wheel) throw new Error("The wheel moved while a pedal was asked for. Begin again, and hold the wheel straight for the pedals.");
  const pedal = (name, values) => ({ ...channelOf(pad, pedals[name]), rest: rest[pedals[name]], full: values[pedals[name]] });
  const preset = pad.mapping === "standard" ? STANDARD : WHEEL_DEFAULTS;
  return {
    steer: { ...channelOf(pad, wheel), left: left[wheel], centre: rest[wheel], right: right[wheel] },
    throttle: pedal("throttle", throttle),
    brake: pedal("brake", brake),
    deadZone: preset.deadZone,
    linearity: preset.linearity,
  };
}

class CalibrationDialog {
  constructor(gamepad) {
    this.gamepad = gamepad;
    $("pad-calibrate").addEventListener("click", () => this.begin());
    $("pad-next").addEventListener("click", () => this.next());
    for (const [id, name] of [["pad-dead", "deadZone"], ["pad-linear", "linearity"]]) $(id).addEventListener("input", () => this.change(name, Number($(id).value)));
    setInterval(() => $("settings").open && this.show(), TICK_MS);
  }

  get pad() {
    return [...(navigator.getGamepads?.() ?? [])].find((pad) => pad?.connected);
  }

  begin() {
    this.step = 0;
    this.readings = {};
    this.say(STEPS[0].text);
    $("pad-next").hidden = false;
    $("pad-next").focus();
  }

  next() {
    try {
      this.readings[STEPS[this.step].key] = checkValues(this.pad, readValues(this.pad));
      this.step += 1;
      if (this.step === STEPS.length) this.finish();
      else this.say(`${this.step + 1} of ${STEPS.length}: ${STEPS[this.step].text}`);
    } catch (error) {
      this.say(error.message);
      this.step = Math.min(this.step, STEPS.length - 1);
    }
  }

  finish() {
    const calibration = buildCalibration(this.pad, this.readings);
    if (!isCalibration(calibration)) throw new Error("Left, centre and right must differ, and each pedal must move. Calibrate again.");
    const isKept = this.gamepad.calibrate(this.pad, calibration);
    this.say(isKept ? "Done. It is remembered in this browser." : "Done. This browser remembers nothing: it counts until the page is closed.");
    $("pad-next").hidden = true;
  }

  say(text) {
    setText($("pad-step"), text);
  }

  change(name, value) {
    const calibration = this.pad && this.gamepad.calibrationOf(this.pad);
    if (calibration) this.gamepad.calibrate(this.pad, { ...calibration, [name]: value });
  }

  /** What the device says now. */
  show() {
    const { pad } = this;
    $("pad-calibrate").disabled = !pad;
    setText($("pad-name"), pad ? pad.id : "None found. Connect it and press one of its buttons.");
    const calibration = pad && this.gamepad.calibrationOf(pad);
    $("pad-axes").hidden = !calibration;
    if (!calibration) return;
    try {
      const { throttle, brake, steer } = readCalibrated(pad, calibration);
      Object.assign($("pad-steer"), { value: -steer });
      Object.assign($("pad-throttle"), { value: throttle });
      Object.assign($("pad-brake"), { value: brake });
    } catch (error) {
      this.say(error.message);
    }
    this.showKnob("pad-dead", calibration.deadZone);
    this.showKnob("pad-linear", calibration.linearity);
  }

  showKnob(id, value) {
    if (document.activeElement !== $(id)) $(id).value = value;
    setText($(id).nextElementSibling, value.toFixed(2));
  }
}
