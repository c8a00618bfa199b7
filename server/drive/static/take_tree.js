// The takes of a drive as a tree: a line for each from its branch point to its end, over the time of the scenario.

const SVG = "http://www.w3.org/2000/svg";
const ROW_PX = 30;
const LABEL_PX = 190; // room for words behind the longest line
const MARGIN_PX = 12;

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
    this.span = width - 2 * MARGIN_PX - LABEL_PX;
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
    const isHuman = (take.drivers[this.cav] ?? "human") === "human";
    group.append(drawn("line", { x1: from, x2: Math.max(to, from + 1), y1: y, y2: y, stroke: `var(--${isHuman ? "focus" : "mcm"})` }));
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

/** "take 2", "you", "score 87.5" or what it does. */
function describeTake({ number, drivers, status, score }, cav) {
  const driver = drivers[cav] ?? Object.values(drivers)[0] ?? "human";
  const words = { running: "being driven", left: "left, being finished", finished: "not scored yet", void: "void" };
  return [`take ${number}`, driver === "human" ? "you" : driver, typeof score === "number" ? `score ${score.toFixed(1)}` : words[status] ?? status];
}
