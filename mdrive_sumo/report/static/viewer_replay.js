// The replay: what the page carries, unpacked, and what is true at a time. Times are in ticks, and may be fractions.

const JUMP_M = 5; // farther than any road user gets in one tick: do not draw it in between
const PLAN_AGE_TICKS = 10; // 0.5 s

/** Header and tables of the page: gzip of [uint32 length, JSON, int32 tables whose rows are stored as steps]. */
async function readReplay(base64) {
  const packed = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  const headerBytes = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, headerBytes)));
  const tables = {};
  header.columns = Object.fromEntries(header.tables.map(([name, columns]) => [name, columns]));
  let begin = 4 + headerBytes;
  for (const [name, columns, size] of header.tables) {
    tables[name] = summedRows(new Int32Array(buffer.slice(begin, begin + 4 * size)), columns);
    begin += 4 * size;
  }
  return new Replay(header, tables);
}

function summedRows(steps, columns) {
  for (let i = 0; i < steps.length; i++) if (i % columns) steps[i] += steps[i - 1];
  return steps;
}

class Replay {
  constructor(header, tables) {
    Object.assign(this, header);
    this.lastTick = this.ticks - 1;
    this.tables = tables;
    this.endOf = new Map(this.endings.map(([ego, tick, end, text]) => [ego, { tick, end, text }]));
    this.marks = this.marks
      .map(([tick, ego, kind, text, x, y]) => (
        { tick, ego: this.ids.indexOf(ego), name: ego, kind, text: beyond(kind, text), x: x / 100, y: y / 100 }
      ))
      .sort((a, b) => a.tick - b.tick);
    this.columnOf = new Map(this.ids.map((id, i) => [id, i]));
    this.changesOf = new Map();
    for (const [tick, tls, state] of this.signals) {
      if (!this.changesOf.has(tls)) this.changesOf.set(tls, []);
      this.changesOf.get(tls).push({ tick, state });
    }
    this.reasonsOf = this.ids.slice(0, this.egos).map(() => []); // why each CAV drives as it does, in order
    for (const [tick, ego, kind, text] of this.notes) {
      if (kind === "reason" && this.columnOf.has(ego)) this.reasonsOf[this.columnOf.get(ego)]?.push({ tick, text });
    }
    this.plansOf = this.ids.slice(0, this.egos).map(() => []);
    let first = 0;
    for (const [tick, ego, count] of this.plans) {
      this.plansOf[ego].push({ tick, first, count });
      first += count;
    }
    this.planColumns = first;
  }

  seconds(tick) {
    return tick * this.tick_s;
  }

  present(i, tick) {
    return this.tables.valid[i * this.ticks + tick] === 1;
  }

  /** Writes x, y [m], yaw [rad], speed [m/s] of road user i into `out`; false if it is not there. */
  sample(i, time, out) {
    const a = Math.floor(time);
    if (!this.present(i, a)) return false;
    const b = Math.min(a + 1, this.lastTick);
    const motion = this.tables.motion;
    const [x, y, yaw, speed] = [0, 1, 2, 3].map((row) => (4 * i + row) * this.ticks);
    const dx = motion[x + b] - motion[x + a];
    const dy = motion[y + b] - motion[y + a];
    const moves = this.present(i, b) && Math.hypot(dx, dy) < JUMP_M * 1000;
    const share = moves ? time - a : 0;
    out.x = (motion[x + a] + share * dx) / 1000;
    out.y = (motion[y + a] + share * dy) / 1000;
    out.yaw = motion[yaw + a] / 10000 + share * shortestTurn((motion[yaw + b] - motion[yaw + a]) / 10000);
    out.speed = (motion[speed + a] + share * (motion[speed + b] - motion[speed + a])) / 1000;
    return true;
  }

  speed(i, tick) {
    return this.tables.motion[(4 * i + 3) * this.ticks + tick] / 1000;
  }

  /** Throttle, brake in [0, 1] (which = 0, 1) or steer in [-1, 1] (2) applied after the tick. */
  control(ego, which, tick) {
    return this.tables.controls[(3 * ego + which) * this.ticks + tick] / 10000;
  }

  /** Points [[x, y], ...] of the last plan at or before the tick, none if it is older than half a second. */
  planAt(ego, tick) {
    const plan = lastAtOrBefore(this.plansOf[ego], tick);
    if (!plan || tick - plan.tick > PLAN_AGE_TICKS) return [];
    const points = this.tables.plan_points;
    return Array.from({ length: plan.count }, (_, j) => [
      points[plan.first + j] / 100,
      points[this.planColumns + plan.first + j] / 100,
    ]);
  }

  /** SUMO's letter of a light "tls:index". */
  signalAt(light, tick) {
    const cut = light.lastIndexOf(":");
    const change = lastAtOrBefore(this.changesOf.get(light.slice(0, cut)) ?? [], tick);
    return change?.state[Number(light.slice(cut + 1))] ?? "";
  }

  /** Contacts of the last `ticks`, the latest of each pair: column of the CAV, id of the other, age [ticks]. */
  contactsWithin(time, ticks) {
    const latest = new Map();
    for (const [tick, ego, other] of this.contacts) {
      if (tick <= time && time - tick < ticks) latest.set(`${ego} ${other}`, { ego, other, age: time - tick });
    }
    return [...latest.values()];
  }

  /** What the CAV is doing at the tick, and how good that is: "ok", "good", "warn" or "bad". */
  stateOf(ego, tick) {
    const end = this.endOf.get(ego);
    if (!end || tick < end.tick) {
      const reason = lastAtOrBefore(this.reasonsOf[ego], tick)?.text ?? "driving";
      return { text: this.present(ego, tick) ? reason : "not in the world", grade: "ok" };
    }
    return { text: `${end.end} at ${this.seconds(end.tick).toFixed(1)} s`, detail: end.text, grade: gradeOf(end.end) };
  }
}

/** What the text of an event says beyond its kind. */
function beyond(kind, text) {
  return text.startsWith(kind) ? text.slice(kind.length).replace(/^[\s,:]+/, "") : text;
}

function lastAtOrBefore(sorted, tick) {
  let low = 0;
  let high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle].tick <= tick) low = middle + 1;
    else high = middle;
  }
  return sorted[low - 1];
}

function shortestTurn(angle) {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}

function gradeOf(kind) {
  if (kind === "arrived") return "good";
  return kind.startsWith("collision") || kind === "agent-failed" ? "bad" : "warn";
}
