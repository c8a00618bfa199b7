// What the own CAV learned over V2X: shared objects and intentions of the last second, warnings, and last words.

const FRESH_TICKS = 20; // CAM and CPM come 1 to 10 times a second (EN 302 637-2): older ones say too little about now
const WORDS_TICKS = 120; // words stay for six seconds

class Exchange {
  constructor() {
    this.forget();
  }

  forget() {
    this.shared = new Map(); // sender -> {tick, objects}
    this.intentions = new Map(); // sender -> {tick, path}
    this.listed = []; // intentions as they were listed last
    this.words = new Map(); // sender -> {tick, text, at}
    this.warnings = new Map(); // sender and cause -> {until, from, text, x, y}
  }

  /** Takes the messages of a frame; returns those that are words. */
  take(messages, tick) {
    for (const { from, kind, objects, path, text, at } of messages) {
      if (kind === "cpm" && objects) this.shared.set(from, { tick, objects });
      if (path?.length) this.intentions.set(from, { tick, path });
      if (text) this.words.set(from, { tick, text, at });
    }
    for (const message of messages) if (message.kind === "denm") this.takeWarning(message, tick);
    return messages.filter(({ kind, text }) => kind === "text" && text);
  }

  /** Each event is repeated until it is over; the last place counts. */
  takeWarning({ from, cause, event: [x, y], valid_ticks: ticks, ended }, tick) {
    const name = `${from} ${cause}`;
    if (ended) this.warnings.delete(name);
    else this.warnings.set(name, { until: tick + ticks, from, text: cause, x, y });
  }

  /**
   * What is still fresh in a tick: shared objects move on with their speed. Words stand at their speaker, one of `users`.
   * `colourOf(sender)`: everything is in the colour of who told of it.
   */
  at(tick, users, colourOf) {
    const fresh = (table, ticks) => [...table].filter(([, entry]) => tick - entry.tick <= ticks);
    const move = ([from, { tick: sent, objects }]) => objects.map((object) => ({ ...moveOn(object, (tick - sent) * TICK_S), colour: colourOf(from) }));
    return {
      shared: fresh(this.shared, FRESH_TICKS).flatMap(move),
      intentions: this.listIntentions(fresh(this.intentions, FRESH_TICKS), colourOf),
      warnings: [...this.warnings.values()].filter(({ until }) => tick <= until),
      words: fresh(this.words, WORDS_TICKS).flatMap(([from, { text, at }]) => {
        const speaker = users.find(({ id }) => id === from) ?? (at && { x: at[0], y: at[1] });
        return speaker ? [{ from, text, x: speaker.x, y: speaker.y }] : [];
      }),
    };
  }

  /** The same list as long as nothing changes: the 3-D view builds its ribbons anew for another one. */
  listIntentions(fresh, colourOf) {
    const isSame = fresh.length === this.listed.length && fresh.every(([, { path }], i) => this.listed[i].path === path);
    if (!isSame) this.listed = fresh.map(([from, { path }]) => ({ from, path, colour: colourOf(from) }));
    return this.listed;
  }
}

function moveOn([x, y, yaw, length, width, speed], seconds) {
  return { x: x + Math.cos(yaw) * speed * seconds, y: y + Math.sin(yaw) * speed * seconds, yaw, length, width };
}

function shortened(text) {
  return text.length > 42 ? `${text.slice(0, 40)} …` : text;
}
