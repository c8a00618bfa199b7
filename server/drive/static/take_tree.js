// The takes of a drive as a tree: a line for each from its branch point to its end, over the time of the scenario.

const SVG = "http://www.w3.org/2000/svg";
const ROW_PX = 30;
const LETTER_PX = 6.4; // room for words behind the longest line: for each letter of the longest, at most half of the window
const MARGIN_PX = 12;
const MOST_NAMED = 3; // stretches whose drivers are named one by one
const NOBODY = ""; // the driver of a CAV that its person has left

class TakeTree {
  /** `choose(take)` is called for a take that is clicked. */
  constructor(choose) {
    this.svg = $("tree");
    this.choose = choose;
    this.takes = [];
  }

  /** Draws the takes; `chosen`: number of the one whose time is shown, `cav`: whose drivers are named. */
  draw(takes, chosen, current, cav) {
    Object.assign(this, { takes, chosen, current, cav });
    const width = Math.max(300, $("tree-scroll").clientWidth - 4);
    this.lastTick = Math.max(200, ...takes.map(({ end_tick, tick }) => Math.max(end_tick, tick)));
    const letters = Math.max(0, ...takes.map((take) => describeTake(take, cav).join(" · ").length));
    this.span = width - 2 * MARGIN_PX - Math.min(letters * LETTER_PX + MARGIN_PX, width / 2);
    this.svg.setAttribute("width", width);
    this.svg.setAttribute("height", orderTakes(takes).length * ROW_PX);
    const rows = new Map(orderTakes(takes).map((take, row) => [take.number, row]));
    this.svg.replaceChildren(...takes.map((take) => this.drawTake(take, rows, width)), this.drawCursor());
  }

  xOf(tick) {
    return MARGIN_PX + (tick / this.lastTick) * this.span;
  }

  drawCursor() {
    this.cursor = drawn("line", { class: "cursor", y1: 0, y2: this.svg.getAttribute("height") });
    return this.cursor;
  }

  moveCursor(tick) {
    for (const name of ["x1", "x2"]) this.cursor?.setAttribute(name, this.xOf(tick));
  }

  /** A part of a take's line in the colour of who drove; its words are shown by the pointer. */
  drawStretch({ from, to, driver }, y) {
    const [x1, x2] = [this.xOf(from), this.xOf(to)];
    const line = drawn("line", { x1, x2: Math.max(x2, x1 + 1), y1: y, y2: y, stroke: `var(--${STRETCH_COLOURS[driver] ?? "mcm"})`, "data-driver": driver });
    const words = drawn("title", {});
    const [begin, end] = [from, to].map((tick) => formatTime(tick * TICK_S));
    words.textContent = driver === NOBODY ? `left at ${begin}` : `${nameDriver(driver, this.cav)}, ${begin} to ${end}`;
    line.append(words);
    return line;
  }

  drawTake(take, rows, width) {
    const y = (rows.get(take.number) + 0.5) * ROW_PX;
    const [from, to] = [this.xOf(take.tick), this.xOf(Math.max(take.end_tick, take.tick))];
    const words = describeTake(take, this.cav);
    const isChosen = take.number === this.chosen;
    const group = drawn("g", { class: `take${isChosen ? " chosen" : ""}`, tabindex: 0, role: "button", "aria-pressed": isChosen, "aria-label": words.join(", ") });
    group.append(drawn("rect", { class: "hit", x: 0, y: y - ROW_PX / 2 + 1, width, height: ROW_PX - 2, rx: 7 }));
    if (take.parent !== null && rows.has(take.parent)) {
      const above = (rows.get(take.parent) + 0.5) * ROW_PX;
      group.append(drawn("path", { class: "branch", d: `M${from} ${above}V${y}` }));
    }
    for (const stretch of listStretches(take, this.cav)) group.append(this.drawStretch(stretch, y));
    group.append(drawn("circle", { cx: from, cy: y, r: 4, fill: "var(--muted)" }));
    const label = drawn("text", { x: Math.max(to, from) + 12, y: y + 4 });
    label.textContent = words.slice(0, 2).join(" · ");
    const rest = drawn("tspan", { class: "small", dx: 8 });
    rest.textContent = words.slice(2).join(" · ");
    label.append(rest);
    group.append(label);
    group.addEventListener("click", () => this.choose(take.number));
    group.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      event.stopPropagation();
      this.choose(take.number);
      this.svg.querySelector(".chosen")?.focus();
    });
    return group;
  }
}

/** "human" drives in blue, agents in the colour of plans; after the person has left, nobody does. */
const STRETCH_COLOURS = { human: "focus", [NOBODY]: "muted" };

function drawn(name, attributes) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

/** Parents before their children, children in the order of their numbers. */
function orderTakes(takes) {
  const numbers = new Set(takes.map(({ number }) => number));
  const below = (parent) => takes.filter((take) => (numbers.has(take.parent) ? take.parent : null) === parent).flatMap((take) => [take, ...below(take.number)]);
  return below(null);
}

/** Who drove a CAV (of spectators: the first one) from which tick to which: [{from, to, driver}]. */
function listStretches({ tick, end_tick, left_tick, drivers, changes = [] }, cav) {
  const shown = cav ?? Object.keys(drivers)[0];
  const begins = [{ from: tick, driver: drivers[shown] ?? "human" }];
  for (const one of changes) if (one.cav === shown) begins.push({ from: one.tick, driver: one.driver });
  const hasLeft = typeof left_tick === "number" && begins.at(-1).driver === "human";
  if (hasLeft) begins.push({ from: left_tick, driver: NOBODY });
  const last = Math.max(end_tick, tick);
  const driven = begins.map((one, i) => ({ ...one, to: begins[i + 1]?.from ?? last })).filter(({ from, to }) => to > from);
  return driven.length ? driven : [{ ...begins.at(-1), to: last }];
}

function nameDriver(driver, cav) {
  return driver === "human" ? (cav ? "you" : "a person") : driver;
}

/** "you", "you → sharing → you", or of many stretches "you and sharing, 6 stretches". */
function nameDrivers(take, cav) {
  const driven = listStretches(take, cav).filter(({ driver }) => driver !== NOBODY).map(({ driver }) => nameDriver(driver, cav));
  if (driven.length <= MOST_NAMED) return driven.join(" → ");
  return `${[...new Set(driven)].join(" and ")}, ${driven.length} stretches`;
}

/** "score 75.0 (all 87.5)": that of the own CAV, and the mean of all where it differs. */
function describeScore({ score, ds }, cav) {
  const own = ds?.[cav] ?? score;
  const all = Math.abs(own - score) < 0.05 ? "" : ` (all ${score.toFixed(1)})`;
  return `score ${own.toFixed(1)}${all}`;
}

/** "take 2", "you → sharing", "score 87.5" or what it does. */
function describeTake(take, cav) {
  const { number, status, score } = take;
  const words = { running: "being driven", left: "left, being finished", finished: "not scored yet", void: "void" };
  return [`take ${number}`, nameDrivers(take, cav), typeof score === "number" ? describeScore(take, cav) : words[status] ?? status];
}
