// What the own CAV learned over V2X: shared objects and intentions of the last second, and last words.

const FRESH_TICKS = 20; // CAM and CPM come 1 to 10 times a second (EN 302 637-2): older ones say too little about now
const WORDS_TICKS = 120; // words stay for six seconds

class Exchange {
  constructor() {
    this.forget();
  }

  forget() {
    this.shared = new Map(); // sender -> {tick, objects}
    this.intentions = new Map(); // sender -> {tick, path}
    this.words = new Map(); // sender -> {tick, from, text, at}
  }

  /** Takes the messages of a frame; returns those that are words. */
  take(messages, tick) {
    for (const { from, kind, objects, path, text, at } of messages) {
      if (kind === "cpm" && objects) this.shared.set(from, { tick, objects });
      if (path?.length) this.intentions.set(from, { tick, path });
      if (text) this.words.set(from, { tick, from, text, at });
    }
    return messages.filter(({ kind, text }) => kind === "text" && text);
  }

  /** What is still fresh in a tick: shared objects move on with their speed. Words stand at their speaker, one of `users`. */
  at(tick, users) {
    const fresh = (table, ticks) => [...table.values()].filter((entry) => tick - entry.tick <= ticks);
    return {
      shared: fresh(this.shared, FRESH_TICKS).flatMap(({ tick: sent, objects }) => objects.map((object) => moveOn(object, (tick - sent) * TICK_S))),
      intentions: fresh(this.intentions, FRESH_TICKS).map(({ path }) => ({ path })),
      words: fresh(this.words, WORDS_TICKS).flatMap(({ from, text, at }) => {
        const speaker = users.find(({ id }) => id === from) ?? (at && { x: at[0], y: at[1] });
        return speaker ? [{ text: shortened(text), x: speaker.x, y: speaker.y }] : [];
      }),
    };
  }
}

function moveOn([x, y, yaw, length, width, speed], seconds) {
  return { x: x + Math.cos(yaw) * speed * seconds, y: y + Math.sin(yaw) * speed * seconds, yaw, length, width };
}

function shortened(text) {
  return text.length > 42 ? `${text.slice(0, 40)} …` : text;
}
