// The motion of a whole take (`server/drive/worker/motion.py`), kept in the browser, so that any tick is shown at once.

const KEPT_MOTIONS = 6; // takes of a minute have some 2 MB each with heavy traffic

class Motion {
  constructor(buffer) {
    const size = new DataView(buffer).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
    this.ticks = header.ticks;
    this.signals = header.signals;
    this.names = new Map(header.names.map((row) => [row[0], readName(row)]));
    this.begins = new Uint32Array(buffer, 4 + size, header.ticks + 1);
    this.rows = new DataView(buffer, 4 + size + 4 * (header.ticks + 1));
  }

  /** The road users of a tick. */
  at(tick) {
    const row = Math.min(Math.max(tick, 0), this.ticks - 1);
    const shown = [];
    for (let i = this.begins[row]; i < this.begins[row + 1]; i++) {
      const user = decodeRow(this.rows, i * ROW_BYTES);
      shown.push({ ...this.names.get(user.index), ...user, braking: Boolean(user.flags & FLAG_BRAKING), ended: Boolean(user.flags & FLAG_ENDED) });
    }
    return shown;
  }

  /** Letters of the traffic lights in a tick. */
  signalsAt(tick) {
    const letters = {};
    for (const [from, light, text] of this.signals) if (from <= tick) letters[light] = text;
    return letters;
  }
}

/** Fetches motions, and keeps those of the last takes. */
class MotionStore {
  constructor(token) {
    this.token = token;
    this.motions = new Map(); // take -> Motion
    this.coming = new Map(); // take -> Promise
  }

  get(take) {
    return this.motions.get(take);
  }

  /** Loads the motion of a take up to a tick, unless it is there; takes that go on grow. */
  async load(take, tick) {
    if (this.motions.get(take)?.ticks > tick) return this.motions.get(take);
    if (!this.coming.has(take)) this.coming.set(take, this.fetch(take).finally(() => this.coming.delete(take)));
    return this.coming.get(take);
  }

  async fetch(take) {
    const response = await fetch(`/takes/${take}/motion?token=${encodeURIComponent(this.token)}`);
    if (!response.ok) throw new Error(`The motion of take ${take} is not there yet (${response.status}): try again.`);
    const motion = new Motion(await response.arrayBuffer());
    this.motions.delete(take);
    this.motions.set(take, motion);
    if (this.motions.size > KEPT_MOTIONS) this.motions.delete(this.motions.keys().next().value);
    return motion;
  }
}
