// What drives: keyboard, gamepad or wheel, touch. Whichever was used last has the car; assisted steering replaces only the wheel.

class Inputs {
  constructor(tell) {
    this.keyboard = new Keyboard();
    this.gamepad = new GamepadInput(tell);
    this.touch = new Touch();
    this.source = this.keyboard;
    this.control = { throttle: 0, brake: 0, steer: 0 };
    this.isAssisted = recall("assist", false);
  }

  get device() {
    return this.source.device;
  }

  /** Notes a key; true if it drives. */
  press(code, isDown) {
    const drives = this.keyboard.press(code, isDown);
    if (drives && isDown) this.source = this.keyboard;
    return drives;
  }

  /** Lets go of everything: the page is hidden, a dialog opens, the drive is paused. */
  release() {
    this.keyboard.release();
    this.touch.release();
    this.control = { throttle: 0, brake: 0, steer: 0 };
  }

  /** The control of this moment, `elapsed` s after the last one. */
  read(elapsed, state, vehicle, route) {
    const padControl = this.gamepad.read();
    if (padControl && this.gamepad.isTouched(padControl)) this.source = this.gamepad;
    if (!padControl && this.source === this.gamepad) this.source = this.keyboard;
    if (this.touch.isUsed) this.source = this.touch;
    const keys = this.keyboard.read(elapsed, state.vx, vehicle);
    const touched = this.touch.read(elapsed, state.vx, vehicle);
    const chosen = { keyboard: keys, touch: touched }[this.source.device] ?? padControl;
    const control = { ...chosen };
    if (this.isAssisted && route && !this.keyboard.isSteering && !this.touch.isHeld) control.steer = steerAlong(route, state, vehicle);
    this.control = roundControl(control);
    return this.control;
  }
}
