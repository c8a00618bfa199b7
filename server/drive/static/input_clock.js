// When an input is due: one for each tick of the simulation, so one for each frame that arrives. If frames are late though the
// simulation runs, the inputs go on by the browser's clock, and the frames that come later ask for none.

const LATE_INTERVALS = 1.6; // a frame is late after so many of the usual times between frames
const TICK_MS = 1000 * TICK_S;
const MOST_CREDIT = 20; // inputs ahead of the frames: one second, then the simulation or the network has stopped
const OF_NEW_INTERVAL = 0.2; // weight of the newest time between frames in the usual one
const LONGEST_INTERVAL_MS = 500;
const LEAN_AFTER_MS = 2000; // an input more than necessary is on its way for so long: leave one out

class InputClock {
  constructor() {
    this.forget();
  }

  forget() {
    this.credit = 0; // inputs that were sent before their frame
    this.last = -Infinity; // time of the newest input [ms]
    this.lastFrame = undefined; // time of the newest frame [ms]
    this.interval = TICK_MS; // usual time between frames: longer when the simulation is slow
    this.fat = undefined; // since when more inputs are on their way than necessary
    this.least = Infinity; // inputs on their way that were enough
    this.expected = Infinity; // inputs on their way after one was left out
  }

  /** Notes that a frame arrives. */
  noteFrame(now) {
    if (this.lastFrame !== undefined) this.interval += OF_NEW_INTERVAL * (Math.min(now - this.lastFrame, LONGEST_INTERVAL_MS) - this.interval);
    this.lastFrame = now;
  }

  /** Ticks that pass in this time [ms]: fewer where the simulation is slower than real time. */
  ticksIn(elapsed) {
    return elapsed / Math.max(TICK_MS, this.interval);
  }

  /** Whether a frame that arrives now asks for an input; `waiting` inputs are without an answer, `ack` was used last. */
  isDueByFrame(now, waiting, ack) {
    if (this.credit > 0) {
      this.credit -= 1;
      return false;
    }
    if (ack > 0 && this.isTooMany(now, waiting)) return false;
    this.last = now;
    return true;
  }

  /** Whether an input is due because no frame has come for too long. */
  isDueByTime(now) {
    const isLate = now - (this.lastFrame ?? now) > LATE_INTERVALS * this.interval;
    if (!isLate || now - this.last < TICK_MS || this.credit >= MOST_CREDIT) return false;
    this.credit += 1;
    this.last = now;
    return true;
  }

  /** After a delay more inputs stay on their way than the network needs: each costs a tick of reaction. */
  isTooMany(now, waiting) {
    if (waiting <= this.least) {
      this.least = waiting;
      this.fat = undefined;
      return false;
    }
    this.fat ??= now;
    if (now - this.fat < LEAN_AFTER_MS) return false;
    this.fat = undefined;
    if (waiting > this.expected) { // the last time did not help: as many are necessary
      this.least = waiting;
      this.expected = Infinity;
      return false;
    }
    this.expected = waiting - 1;
    return true;
  }
}
