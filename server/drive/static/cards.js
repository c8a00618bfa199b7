// The card in the middle: start, waiting, lost connection, end.

class Card {
  constructor() {
    this.shown = undefined;
  }

  /** Shows a card: {key, title, body: [nodes], actions: [[label, action, isFirst]]}; one with the same key is only updated. */
  show({ key, title, body = [], actions = [] }) {
    const isNew = this.shown !== key;
    this.shown = key;
    setText($("card-title"), title);
    $("card-body").replaceChildren(...body);
    if (!isNew) return;
    $("card-actions").replaceChildren(...actions.map(([label, action], i) => this.button(label, action, i === 0)));
    $("card").hidden = false;
    $("card-actions").firstElementChild?.focus({ preventScroll: true });
  }

  button(label, action, isFirst) {
    const button = make("button", isFirst ? "first" : "second", label);
    button.addEventListener("click", action);
    return button;
  }

  hide() {
    this.shown = undefined;
    $("card").hidden = true;
  }
}

const COLLISION_MS = 5000; // long enough to be read after the first fright
const ARTICLES = { obstacle: "an" };

/** Collisions, said the moment they happen: what the own CAV hit, and what other CAVs did. */
class CollisionNotice {
  tell(collisions, { cav, cavs }) {
    const own = collisions.filter((one) => one.cav === cav);
    const others = collisions.filter((one) => one.cav !== cav && one.id !== cav);
    const names = new Set(cavs.map(({ id }) => id));
    const nameOther = (one) => (names.has(one.id) ? nameCav(one.id) : `${ARTICLES[one.with] ?? "a"} ${one.with}`);
    const words = [...own.map((one) => `Collision with ${nameOther(one)}`), ...others.map((one) => `${nameCav(one.cav)}: collision with ${nameOther(one)}`)];
    if (!words.length) return;
    $("collision").hidden = false;
    setText($("collision"), [...new Set(words)].join("; "));
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.hide(), COLLISION_MS);
  }

  hide() {
    $("collision").hidden = true;
  }
}

function paragraph(text, className) {
  return make("p", className, text);
}

function startBody({ description, cav, weather, cavs, role, return_path: studyPath, takes, tick_s }) {
  const people = cavs.filter(({ driver }) => driver === "human").map(({ id }) => id);
  const facts = make("dl", "facts");
  const rows = [["Your CAV", role === "spectator" ? "none: you watch" : nameCav(cav)], ["Driven by people", people.map(nameCav).join(", ")]];
  const entered = takes.find(({ number }) => number === 1)?.tick; // of a recorded run: the car may be fast already
  if (entered && role === "driver") rows.push(["You enter at", `${formatTime(entered * tick_s)} of a recorded run; the car may be moving`]);
  if (weather !== "default") rows.push(["Weather", weather]);
  const task = paragraph(studyPath ? "Follow the blue line on the road to its end." : description);
  for (const [term, text] of rows) facts.append(make("dt", "", term), make("dd", "", text));
  if (!$("touch").hidden) return [task, facts, paragraph("Turn the wheel; press a pedal, the higher the more.", "keys")];
  const keys = make("p", "keys");
  keys.append(make("kbd", "", "W"), " throttle ", make("kbd", "", "S"), " brake ", make("kbd", "", "A"), make("kbd", "", "D"), " steer ", make("kbd", "", "P"), " pause ", make("kbd", "", "?"), " help");
  return [task, facts, keys];
}

function endBody({ score, take, takes, welcome, isDriver }, endings) {
  const stored = takes.find(({ number }) => number === take);
  const body = [];
  const total = stored?.score ?? score?.ds;
  const scores = stored?.ds ?? score?.cavs ?? {};
  if (typeof total === "number") body.push(...totalBody(total, scores, welcome.cav));
  const list = make("dl", "facts");
  for (const cav of new Set([...Object.keys(endings), ...Object.keys(stored?.ds ?? {})])) {
    const word = endings[cav]; // none for who had not ended when the take was ended early
    const ds = scores[cav];
    list.append(make("dt", "", cav === welcome.cav ? `${nameCav(cav)} (you)` : nameCav(cav)), make("dd", word ? (word === "arrived" ? "good" : "bad") : "", [word, typeof ds === "number" ? `driving score ${ds.toFixed(1)}` : ""].filter(Boolean).join(", ")));
    const losses = stored?.losses?.[cav];
    if (losses) list.append(make("dt"), make("dd", "muted", losses));
  }
  body.push(list);
  if (isDriver && welcome.may_rewind) body.push(paragraph("Drag the time back to try again from there."));
  if (stored?.folder && !welcome.return_path) {
    const commands = ["explain", "view", "verify"].map((command) => `mdrive-sumo ${command} ${stored.folder}`);
    body.push(paragraph("The story of this take, its replay, and a check, in the folder of the drive:"), make("pre", "", commands.join("\n")));
  }
  return body;
}

/** The score of the own CAV, and those of all where others have another one: scenarios are scored by their mean. */
function totalBody(total, scores, cav) {
  const values = Object.values(scores);
  const isOne = cav === null || !(cav in scores);
  if (values.length < 2 || values.every((value) => Math.abs(value - total) < 0.05)) return [bigNumber(total, "driving score, of 100")];
  const lowest = Object.entries(scores).reduce((least, one) => (one[1] < least[1] ? one : least));
  const rest = `lowest ${lowest[1].toFixed(1)} (${lowest[0] === cav ? "yours" : nameCav(lowest[0])})`;
  if (isOne) return [bigNumber(total, "driving score, mean of all CAVs, of 100"), paragraph(rest, "muted")];
  return [bigNumber(scores[cav], "driving score of your CAV, of 100"), paragraph(`All CAVs: mean ${total.toFixed(1)}, ${rest}`, "muted")];
}

function bigNumber(total, words) {
  const line = make("p", "total");
  line.append(make("b", "", total.toFixed(1)), make("span", "", words));
  return line;
}
