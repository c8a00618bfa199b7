// The panel: CAVs with state and speed, events, facts of the run.

class Panel {
  constructor(replay, { select, follow, seek }) {
    this.replay = replay;
    document.getElementById("scenario").textContent = replay.scenario;
    document.getElementById("category").textContent = replay.category;
    document.getElementById("description").textContent = replay.description;
    this.addScores();
    const list = document.getElementById("cavs");
    list.classList.toggle("told", replay.reasonsOf.some((reasons) => reasons.length > 0));
    this.rows = replay.ids.slice(0, replay.egos).map((id, ego) => this.addCav(list, id, ego, select, follow));
    this.addEvents(seek);
    this.addFacts();
  }

  /** Scores of the scenario, where the page has them. */
  addScores() {
    const { scores } = this.replay;
    const list = document.getElementById("scores");
    list.hidden = !scores;
    if (!scores) return;
    const texts = { DS: percent(scores.ds), SR: percent(scores.sr), RC: percent(scores.rc), IP: scores.ip.toFixed(2) };
    for (const [name, text] of Object.entries(texts)) {
      const item = element("div", "");
      item.append(element("dt", "", name), element("dd", "", text));
      list.append(item);
    }
  }

  addCav(list, id, ego, select, follow) {
    const row = element("li", "cav");
    const choose = element("button", "choose");
    const swatch = element("span", "swatch");
    swatch.style.background = colourOf(ego);
    const state = element("span", "state");
    const speed = element("span", "speed");
    choose.append(swatch, element("span", "name", id), speed, state);
    const scores = this.replay.scores?.egos[ego];
    if (scores) choose.append(element("span", "score", `DS ${percent(scores[0])} · RC ${percent(scores[1])} · IP ${scores[2].toFixed(2)}`));
    choose.setAttribute("aria-label", `Select ${id}`);
    choose.addEventListener("click", () => select(ego));
    const target = element("button", "target", "◎");
    target.setAttribute("aria-label", `Follow ${id}`);
    target.addEventListener("click", () => follow(ego));
    row.append(choose, target);
    list.append(row);
    return { row, choose, target, state, speed };
  }

  addEvents(seek) {
    const { replay } = this;
    const list = document.getElementById("events");
    this.events = replay.marks.map((mark) => {
      const button = element("button", `event ${gradeOf(mark.kind)}`);
      const dot = element("span", "dot");
      const where = element("span", "where");
      const swatch = element("span", "swatch small");
      swatch.style.background = mark.ego >= 0 ? colourOf(mark.ego) : "transparent";
      where.append(swatch, mark.text ? `${mark.name} · ${mark.text}` : mark.name);
      button.append(dot, element("time", "", `${replay.seconds(mark.tick).toFixed(1)} s`), element("span", "what", mark.kind), where);
      button.addEventListener("click", () => seek(mark.tick));
      const item = element("li", "");
      item.append(button);
      list.append(item);
      return { button, tick: mark.tick };
    });
    if (!replay.marks.length) list.append(element("li", "none", "None."));
  }

  addFacts() {
    const { replay } = this;
    const signs = replay.map.signs_known ? `${replay.map.stops.length} near` : "unknown on this map";
    const facts = { network: replay.network, ...replay.about, "road users": replay.ids.length, "stop signs": signs };
    for (const [name, value] of Object.entries(facts)) {
      document.getElementById("about").append(element("dt", "", name), element("dd", "", String(value)));
    }
  }

  show(tick, selected, followed) {
    if (this.tick === tick && this.selected === selected && this.followed === followed) return;
    Object.assign(this, { tick, selected, followed });
    this.rows.forEach(({ row, choose, target, state, speed }, ego) => {
      const now = this.replay.stateOf(ego, tick);
      const here = this.replay.present(ego, tick);
      row.className = `cav ${now.grade} ${here ? "here" : "gone"}`;
      choose.setAttribute("aria-pressed", ego === selected);
      target.setAttribute("aria-pressed", ego === followed);
      setText(state, now.detail ? `${now.text} · ${now.detail}` : now.text);
      state.title = state.textContent;
      speed.textContent = here ? `${this.replay.speed(ego, tick).toFixed(1)} m/s` : "";
    });
    for (const { button, tick: at } of this.events) button.classList.toggle("past", at <= tick);
  }
}

function percent(value) {
  return `${value.toFixed(1)} %`;
}

/** An element with a text that is never read as markup. */
function element(tag, className, text = "") {
  const made = document.createElement(tag);
  made.className = className;
  made.textContent = text;
  return made;
}

function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function pressed(button, is) {
  if (button.getAttribute("aria-pressed") !== String(is)) button.setAttribute("aria-pressed", is);
}
