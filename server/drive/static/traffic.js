// The other road users between two frames. Each frame holds their poses of one tick; the picture shows them at the time of the
// own car, which is a little ahead: up to `MOST_BEYOND` ticks they move on with their last speed and turn.

const MOST_BEYOND = 3; // ticks: in 150 ms a braking car (4 m/s2) is 4.5 cm from where it is shown
const KINDS = ["vehicle", "pedestrian", "cyclist", "static"];
const FLAG_BRAKING = 1;
const FLAG_ENDED = 2;

class Traffic {
  constructor() {
    this.names = new Map(); // index -> {id, kind, length, width, height, model, paint}
    this.forget();
  }

  forget() {
    this.before = undefined;
    this.last = undefined;
  }

  /** Learns the names of a frame's extra part: [[index, id, kind, length, width, height, model, paint], ...]. */
  learn(names) {
    for (const row of names) this.names.set(row[0], readName(row));
  }

  take({ tick, rows }) {
    if (this.last && tick <= this.last.tick) this.forget();
    this.before = this.last;
    this.last = { tick, rows: new Map(rows.map((row) => [row.index, row])) };
  }

  /** The road users at a time [ticks]: {index, id, kind, ..., x, y, yaw, speed, lamps, braking, ended}. */
  at(time) {
    if (!this.last) return [];
    const shown = [];
    for (const row of this.last.rows.values()) {
      const name = this.names.get(row.index);
      if (!name) continue;
      const ended = Boolean(row.flags & FLAG_ENDED);
      shown.push({ ...name, ...row, ...this.poseOf(row, time), braking: Boolean(row.flags & FLAG_BRAKING), ended });
    }
    return shown;
  }

  poseOf(row, time) {
    const past = this.before?.rows.get(row.index);
    const ticks = past ? this.last.tick - this.before.tick : 0;
    const beyond = Math.min(time - this.last.tick, MOST_BEYOND);
    if (!ticks || beyond < -ticks) return { x: row.x, y: row.y, yaw: row.yaw };
    const turn = wrapAngle(row.yaw - past.yaw) / ticks;
    if (beyond <= 0) {
      const share = 1 + beyond / ticks;
      return { x: past.x + (row.x - past.x) * share, y: past.y + (row.y - past.y) * share, yaw: past.yaw + turn * ticks * share };
    }
    return { x: row.x + ((row.x - past.x) / ticks) * beyond, y: row.y + ((row.y - past.y) / ticks) * beyond, yaw: row.yaw + turn * beyond };
  }
}

/** A row of a table of names; `kind` is a value of `mdrive_sumo.core.state.Kind`. */
function readName([index, id, kind, length, width, height, model, paint]) {
  return { index, id, kind: KINDS[kind], length, width, height, model, paint };
}
