// The lists beside the scene: messages of the selected CAV around now, and the transcript of the negotiation.

const MOST_MESSAGES = 40;

class Lists {
  constructor(replay, talk, { seek, open, redraw }) {
    Object.assign(this, { replay, talk, seek, shown: "events" });
    this.types = new Set(talk.types.length > 1 ? talk.types.filter((type) => type !== "cam") : talk.types);
    this.tabs = new Map([...document.querySelectorAll("#tabs button")].map((tab) => [tab.dataset.list, tab]));
    for (const [name, tab] of this.tabs) tab.addEventListener("click", () => open(name));
    this.addFilters(redraw);
    this.addRows();
    this.addTranscript();
  }

  /** Shows one of the lists: "events", "messages" or "transcript". */
  show(name) {
    this.shown = name;
    for (const [other, tab] of this.tabs) {
      tab.setAttribute("aria-selected", other === name);
      document.getElementById(`list-${other}`).hidden = other !== name;
    }
    this.tick = undefined;
  }

  /** Which types are listed and drawn. */
  addFilters(redraw) {
    for (const type of this.talk.types) {
      const chip = element("button", `chip ${type}`, type);
      const press = () => chip.setAttribute("aria-pressed", this.types.has(type));
      chip.setAttribute("aria-label", `Show ${type} messages`);
      chip.addEventListener("click", () => {
        if (!this.types.delete(type)) this.types.add(type);
        press();
        this.tick = undefined;
        redraw();
      });
      press();
      document.getElementById("filters").append(chip);
    }
  }

  addRows() {
    const list = document.getElementById("messages");
    this.rows = Array.from({ length: MOST_MESSAGES }, () => {
      const parts = ["time", "chip", "who", "size", "fate"].map((name) => element("span", name));
      const button = element("button", "message");
      button.append(...parts);
      const item = element("li", "");
      item.hidden = true; // until it has something to say
      item.append(button);
      list.append(item);
      const row = { item, button, parts };
      button.addEventListener("click", () => this.showDetail(row.entry.message));
      return row;
    });
    document.getElementById("detail-close").addEventListener("click", () => this.showDetail(undefined));
  }

  addTranscript() {
    const list = document.getElementById("transcript");
    this.entries = this.talk.transcript().map((entry) => {
      const item = element("li", `entry ${entry.spoken ? "spoken" : "noted"}`);
      const button = element("button", "");
      const swatch = element("span", "swatch small");
      swatch.style.background = entry.station >= 0 && entry.station < this.replay.egos ? colourOf(entry.station) : "var(--ink)";
      const name = element("b", "", this.talk.stations[entry.station] ?? "");
      button.append(element("time", "", `${this.replay.seconds(entry.tick).toFixed(1)} s`), swatch, name, element("i", "", entry.kind));
      button.append(element("p", "", entry.text));
      button.addEventListener("click", () => this.seek(entry.tick));
      item.append(button);
      if (entry.more) item.append(asked(entry.more));
      list.append(item);
      return { item, tick: entry.tick };
    });
  }

  update(tick, selected) {
    this.last = { tick, selected };
    if (this.tick === tick && this.selected === selected) return;
    Object.assign(this, { tick, selected });
    if (this.shown === "messages") this.updateMessages(tick, selected);
    if (this.shown === "transcript") this.updateTranscript(tick, selected);
  }

  updateMessages(tick, selected) {
    const found = this.talk.around(selected, tick, this.types, MOST_MESSAGES);
    this.rows.forEach((row, i) => {
      row.entry = found[i];
      row.item.hidden = !row.entry;
      if (row.entry) this.fillRow(row, tick);
    });
    document.getElementById("no-messages").hidden = found.length > 0;
  }

  fillRow({ entry: { at, message, fate }, parts, button }, tick) {
    const own = fate === undefined;
    const arrived = message.fates.filter((one) => one.fate === "delivered" && one.tick <= tick).length;
    const texts = [
      this.replay.seconds(at).toFixed(2), message.type, own ? "→ sent" : `← ${this.talk.stations[message.from]}`,
      `${message.bytes} B`, own ? sentOutcome(message, arrived) : outcome(this.replay, message, fate),
    ];
    parts.forEach((part, i) => setText(part, texts[i]));
    parts[1].className = `chip ${message.type}`;
    const good = own ? !message.problem : fate.fate === "delivered";
    button.className = `message ${good ? "" : "bad"} ${message === this.detail ? "open" : ""}`;
  }

  showDetail(message) {
    this.detail = message;
    document.getElementById("detail").hidden = !message;
    if (message) {
      document.getElementById("detail-title").textContent = `${message.type.toUpperCase()} from ${this.talk.stations[message.from]}`;
      const facts = [...headFacts(this.replay, this.talk, message), ...contentFacts(this.replay, this.talk.stations[message.from], message)];
      document.getElementById("detail-facts").replaceChildren(
        ...facts.flatMap(([name, text]) => [element("dt", "", name), element("dd", "", text)]),
      );
    }
    this.tick = undefined;
    this.update(this.last.tick, this.last.selected);
  }

  updateTranscript(tick, selected) {
    const count = countAtOrBefore(this.entries, tick);
    this.entries.forEach(({ item, tick: at }, i) => {
      item.hidden = i >= count;
      item.classList.toggle("newest", i === count - 1 || (i < count && at === this.entries[count - 1].tick));
    });
    document.getElementById("no-words").hidden = count > 0;
    this.updateTerms(tick, selected); // first: its height decides how much is left for the list
    if (count !== this.count && count > 0) {
      const list = document.getElementById("transcript");
      list.scrollTop = this.entries[count - 1].item.offsetTop + this.entries[count - 1].item.offsetHeight - list.clientHeight;
    }
    this.count = count;
  }

  /** What the selected CAV asks, answers and believes now. */
  updateTerms(tick, selected) {
    const mcm = this.talk.newest("mcm", selected, tick)?.content;
    const facts = mcm ? termFacts(this.replay, this.talk.stations[selected], mcm) : [];
    document.getElementById("terms").replaceChildren(
      ...facts.flatMap(([name, text]) => [element("dt", "", name), element("dd", "", text)]),
    );
  }
}

function asked(text) {
  const details = element("details", "");
  details.append(element("summary", "", "what was asked"), element("pre", "", text));
  return details;
}

function sentOutcome(message, arrived) {
  return message.problem ? "malformed" : `${arrived} of ${message.fates.length}`;
}

function outcome(replay, message, { fate, tick }) {
  return fate === "delivered" ? `${Math.round((tick - message.tick) * replay.tick_s * 1000)} ms` : fate;
}

function headFacts(replay, talk, message) {
  const fates = message.fates.map((one) => `${talk.stations[one.to]}: ${one.fate === "delivered" ? "after " : ""}${outcome(replay, message, one)}`);
  return [["sent", `${replay.seconds(message.tick).toFixed(2)} s, ${message.bytes} bytes`], ["to", fates.join("\n") || "no station"]];
}

function contentFacts(replay, own, { type, content, problem }) {
  if (problem) return [["malformed", problem]];
  if (!content) return [["content", "not readable here"]];
  if (["text", "denm", "feature"].includes(type)) return [[type, content.text]];
  if (type === "cam") return camFacts(replay, content);
  return type === "cpm" ? cpmFacts(content) : mcmFacts(replay, own, content);
}

function camFacts(replay, { x, y, yaw, speed, acceleration, yawRate, length, width }) {
  const [x0, y0] = replay.origin;
  return [
    ["place", `x ${(x + x0).toFixed(2)}, y ${(y + y0).toFixed(2)} m`], ["heading", `${degrees(yaw)}°`],
    ["speed", `${speed.toFixed(2)} m/s`], ["acceleration", `${acceleration.toFixed(2)} m/s²`],
    ["yaw rate", `${yawRate.toFixed(3)} rad/s`], ["size", `${length.toFixed(2)} × ${width.toFixed(2)} m`],
  ];
}

function cpmFacts({ range, count, sectors, objects }) {
  const lines = objects?.map((o) => `${o.name} ${o.kind}, ${o.speed.toFixed(1)} m/s, ${o.age} ticks old`);
  const told = lines ? lines.join("\n") || "none" : `${count}; their details are in the page 5 times a second only`;
  return [["range", `${range.toFixed(1)} m`], ["free sight", sectors ? `${sectors} sectors` : "not told"], ["objects", told]];
}

function mcmFacts(replay, own, mcm) {
  return [["speed", `${mcm.speed.toFixed(2)} m/s`], ...termFacts(replay, own, mcm)];
}

function termFacts(replay, own, { intention, direction, requests, answers, group, until }) {
  const facts = [["intention", `${intention}, ${direction}`], ["group", group.join(", ") || "none"]];
  if (requests.length) facts.push(["asks", wishes(own, requests).join("\n")]);
  if (answers.length) facts.push(["answers", answers.map(([station, yes]) => `${station}: ${yes ? "yes" : "no"}`).join("\n")]);
  if (requests.length) facts.push(["until", `${replay.seconds(until).toFixed(1)} s`]);
  return facts;
}

function degrees(yaw) {
  return (((yaw * 180) / Math.PI + 360) % 360).toFixed(1);
}
