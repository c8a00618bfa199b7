// Wheel and pedals on the screen, for phones: the wheel is turned, a pedal gives more the higher it is touched.

const FULL_TURN_RAD = 1.6; // of the wheel on the screen from the centre to the limit
const RETURN_S = 0.25; // back to the centre after the finger is lifted

class Touch {
  constructor() {
    this.device = "touch";
    this.wheel = $("touch-wheel");
    this.pedals = { throttle: $("touch-throttle"), brake: $("touch-brake") };
    this.release();
    this.listenToWheel();
    for (const [name, element] of Object.entries(this.pedals)) this.listenToPedal(name, element);
  }

  release() {
    this.turned = 0; // rad, left positive
    this.isHeld = false;
    this.values = { throttle: 0, brake: 0 };
  }

  get isUsed() {
    return this.isHeld || this.values.throttle > 0 || this.values.brake > 0;
  }

  listenToWheel() {
    let before = 0;
    const angleOf = (event) => {
      const { left, top, width, height } = this.wheel.getBoundingClientRect();
      return Math.atan2(top + height / 2 - event.clientY, event.clientX - left - width / 2);
    };
    this.wheel.addEventListener("pointerdown", (event) => {
      this.wheel.setPointerCapture(event.pointerId);
      before = angleOf(event);
      this.isHeld = true;
    });
    this.wheel.addEventListener("pointermove", (event) => {
      if (!this.isHeld || !this.wheel.hasPointerCapture(event.pointerId)) return;
      this.turned = clampTo(FULL_TURN_RAD, this.turned + wrapAngle(angleOf(event) - before));
      before = angleOf(event);
    });
    for (const end of ["pointerup", "pointercancel"]) this.wheel.addEventListener(end, () => (this.isHeld = false));
  }

  listenToPedal(name, element) {
    const press = (event) => {
      const { bottom, height } = element.getBoundingClientRect();
      this.values[name] = Math.min(1, Math.max(0.1, ((bottom - event.clientY) / height) * 1.15));
    };
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      press(event);
    });
    element.addEventListener("pointermove", (event) => element.hasPointerCapture(event.pointerId) && press(event));
    for (const end of ["pointerup", "pointercancel"]) element.addEventListener(end, () => (this.values[name] = 0));
  }

  read(elapsed, speed, vehicle) {
    if (!this.isHeld) this.turned = moveTo(this.turned, 0, (elapsed * FULL_TURN_RAD) / RETURN_S);
    const steer = (this.turned / FULL_TURN_RAD) * steerLimit(Math.abs(speed), vehicle);
    return { ...this.values, steer };
  }

  /** Turns and fills what is on the screen. */
  show() {
    this.wheel.firstElementChild.style.transform = `rotate(${-this.turned}rad)`;
    for (const [name, element] of Object.entries(this.pedals)) element.firstElementChild.style.height = `${100 * this.values[name]}%`;
  }
}
