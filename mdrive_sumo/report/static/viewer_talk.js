// Messages of the episode: sender, receivers, tick, delivery status and decoded content. Times in ticks, lengths in m.

const FRESH_TICKS = 20; // what is older than a second is not shown as known
const INTENTIONS = ["stop", "slower", "keep", "faster"];
const DIRECTIONS = ["ahead", "left", "right", "straight", "change left", "change right"];
const KINDS = ["vehicle", "pedestrian", "cyclist", "static"];
const SPOKEN = /^\[([0-9a-f]{8}) (\d{1,2})( critic)?\] /; // how agents begin what they say in a negotiation

class Talk {
  constructor(replay) {
    Object.assign(this, replay.talk);
    this.replay = replay;
    const table = (name) => rowsOf(replay.tables[name], replay.columns[name]);
    this.sent = table("messages").map(([type, from, tick, bytes], row) => (
      { row, type: this.types[type], from, tick, bytes, fates: [] }
    ));
    this.arrivals = new Map(); // "type from to" -> [{ tick, message }] of what was delivered
    this.links = new Map(); // "type from to" -> [{ tick, until, message, fate }] by the tick of sending
    this.air = new Map(); // "from to" -> [{ tick, received, name }] of what was transmitted, by the tick of sending
    this.linkNames = new Map(table("links").map(([row, to, kind]) => [`${row} ${to}`, this.link_classes[kind]]));
    for (const [row, to, fate, tick] of table("fates")) this.addFate(this.sent[row], to, this.fates[fate], tick);
    for (const list of this.air.values()) list.sort((a, b) => a.tick - b.tick);
    for (const list of this.arrivals.values()) list.sort((a, b) => a.tick - b.tick || a.message.row - b.message.row);
    for (const [row, problem] of this.problems) this.sent[row].problem = problem; // malformed: the channel has dropped it
    for (const [row, text] of this.texts) this.sent[row].content = { text };
    this.addCams(table("cams"));
    this.addCpms(table("cpms"), table("cpm_objects"));
    this.addMcms(table("mcms"), replay.tables.mcm_points, replay.columns.mcm_points);
    this.bySender = new Map(); // "type from" -> messages in order
    for (const message of this.sent) push(this.bySender, `${message.type} ${message.from}`, message);
  }

  addFate(message, to, fate, tick) {
    message.fates.push({ to, fate, tick });
    const key = `${message.type} ${message.from} ${to}`;
    push(this.links, key, { tick: message.tick, until: tick, message, fate, to });
    if (fate === "delivered") push(this.arrivals, key, { tick, message });
    if (this.not_transmitted.includes(fate) || fate === "gone") return;
    const name = this.linkNames.get(`${message.row} ${to}`) ?? "";
    push(this.air, `${message.from} ${to}`, { tick: message.tick, received: fate === "delivered", name });
  }

  addCams(rows) {
    for (const [row, x, y, yaw, speed, acceleration, turn, length, width] of rows) {
      this.sent[row].content = {
        x: x / 100, y: y / 100, yaw: yaw / 1e4, speed: speed / 100, acceleration: acceleration / 100,
        yawRate: turn / 1000, length: length / 100, width: width / 100,
      };
    }
  }

  addCpms(rows, objects) {
    for (const [row, range, count, sectors, carried] of rows) {
      this.sent[row].content = { range: range / 10, count, sectors, objects: carried ? [] : null };
    }
    for (const [row, track, kind, x, y, yaw, speed, length, width, age] of objects) {
      this.sent[row].content.objects.push({
        name: this.tracks[track], kind: KINDS[kind], x: x / 100, y: y / 100, yaw: yaw / 1e4, speed: speed / 100,
        length: length / 100, width: width / 100, age,
      });
    }
  }

  addMcms(rows, points, columns) {
    let next = 0;
    const take = (count) => {
      const line = Array.from({ length: count }, (_, i) => [points[next + i] / 100, points[columns + next + i] / 100]);
      next += count;
      return line;
    };
    for (const [row, speed, yaw, intention, direction, term, interval, planned, desired] of rows) {
      const [requests, answers, group, until] = this.terms[term];
      this.sent[row].content = {
        speed: speed / 100, yaw: yaw / 1e4, intention: INTENTIONS[intention], direction: DIRECTIONS[direction],
        interval: interval / 100, requests, answers, group, until, planned: take(planned), desired: take(desired),
      };
    }
  }

  has(type) {
    return this.types.includes(type);
  }

  /** The newest of a type that the station has said, if it is not too old. */
  newest(type, from, tick, wanted = () => true) {
    const list = this.bySender.get(`${type} ${from}`) ?? [];
    let i = countAtOrBefore(list, tick) - 1;
    while (i >= 0 && tick - list[i].tick < FRESH_TICKS && !wanted(list[i])) i--;
    return i >= 0 && tick - list[i].tick < FRESH_TICKS ? list[i] : undefined;
  }

  /** The newest CPM with objects that the station has received from each other one: [message]. */
  received(to, tick) {
    const found = [];
    for (let from = 0; from < this.stations.length; from++) {
      const list = this.arrivals.get(`cpm ${from} ${to}`) ?? [];
      let i = countAtOrBefore(list, tick) - 1;
      while (i >= 0 && !list[i].message.content?.objects) i--;
      if (i >= 0 && tick - list[i].message.tick < FRESH_TICKS) found.push(list[i].message);
    }
    return found;
  }

  /** Of each link the newest message of each of the types that set out at or before the time. */
  latestFlights(time, types) {
    const wanted = [...this.links.values()].filter((list) => types.has(list[0].message.type));
    return wanted.map((list) => list[countAtOrBefore(list, time) - 1]).filter(Boolean);
  }

  /** Of each pair of stations what was transmitted within the last second: [{ from, to, share, name }]. */
  linksAt(tick) {
    const found = [];
    for (const [key, list] of this.air) {
      const end = countAtOrBefore(list, tick);
      let begin = end;
      while (begin > 0 && tick - list[begin - 1].tick < FRESH_TICKS) begin--;
      if (begin === end) continue;
      const [from, to] = key.split(" ").map(Number);
      const received = list.slice(begin, end).filter((one) => one.received).length;
      found.push({ from, to, share: received / (end - begin), name: list[end - 1].name });
    }
    return found;
  }

  /** What the station sent and what was sent to it, newest first: [{ at, message, fate }]; fate undefined: its own. */
  around(station, tick, types, most) {
    const found = [];
    for (const [key, list] of this.bySender) {
      const [type, from] = key.split(" ");
      if (!types.has(type)) continue;
      for (let i = countAtOrBefore(list, tick) - 1; i >= 0 && tick - list[i].tick < FRESH_TICKS; i--) {
        const message = list[i];
        if (Number(from) === station) found.push({ at: message.tick, message });
        else {
          const fate = message.fates.find((one) => one.to === station);
          if (fate && fate.tick <= tick) found.push({ at: fate.tick, message, fate });
        }
      }
    }
    return found.sort((a, b) => b.at - a.at || a.message.row - b.message.row).slice(0, most);
  }

  /** Groups that stations take themselves to be in at the tick, each once: [[station, ...], ...]. */
  groupsAt(tick) {
    const groups = new Map();
    for (let ego = 0; ego < this.replay.egos; ego++) {
      const group = [...(this.newest("mcm", ego, tick)?.content?.group ?? [])].sort();
      if (group.length > 1) groups.set(group.join("\n"), group.map((name) => this.stations.indexOf(name)).filter((s) => s >= 0));
    }
    return [...groups.values()];
  }

  /** Station -> its place from 1 in the order of passing that its group has agreed on, at the tick. */
  ranksAt(tick) {
    const ranks = new Map();
    for (let ego = 0; ego < this.replay.egos; ego++) {
      const mcm = this.newest("mcm", ego, tick)?.content;
      if (!mcm || mcm.until < tick || !hasOrder(this.stations[ego], mcm)) continue;
      mcm.group.map((name) => this.stations.indexOf(name)).forEach((station, i) => {
        if (station >= 0 && !ranks.has(station)) ranks.set(station, i + 1);
      });
    }
    return ranks;
  }

  /** What the station asked, answered and believed by MCM, whenever that changed. */
  agreements(station) {
    const found = [];
    let before = "";
    for (const { tick, content } of this.bySender.get(`mcm ${station}`) ?? []) {
      const text = content ? bargain(this.stations[station], content) : before;
      if (text !== before) found.push({ tick, station, kind: "by MCM", text: text || "in no conflict any more", more: "", spoken: false });
      before = text;
    }
    return found;
  }

  /** All that was said in words, agreed by MCM and noted, in order: [{ tick, station, kind, text, more, spoken }]. */
  transcript() {
    const spoken = this.texts.filter(([row]) => this.sent[row].type === "text"); // the others are warnings and features
    const said = spoken.map(([row, text]) => {
      const { tick, from } = this.sent[row];
      const head = SPOKEN.exec(text);
      const kind = head ? `${head[3] ? "critic" : "says"} · round ${head[2]}` : "says";
      return { tick, station: from, kind, text: head ? text.slice(head[0].length) : text, more: "", spoken: true };
    });
    const noted = this.replay.notes
      .map(([tick, ego, kind, text, more]) => ({ tick, station: this.stations.indexOf(ego), kind, text, more, spoken: false }))
      .filter((note) => !joined(said, note));
    const agreed = this.stations.flatMap((_, station) => this.agreements(station));
    return [...said, ...agreed, ...noted].sort((a, b) => a.tick - b.tick);
  }
}

/** Whether the note only tells how something came to be said: then what was asked is told there. */
function joined(said, note) {
  const same = said.find((entry) => entry.tick === note.tick && entry.station === note.station && entry.text === note.text);
  if (same) same.more = note.more;
  return same !== undefined;
}

/** Requests grouped by what is asked, one line per group; the sender's own intention first. */
function wishes(own, requests) {
  const asked = new Map();
  for (const [station, what] of requests) push(asked, `${station === own ? 0 : 1}${what}`, station === own ? "itself" : station);
  return [...asked].sort(([a], [b]) => (a < b ? -1 : 1)).map(([key, names]) => `${names.join(", ")}: ${key.slice(1).toLowerCase()}`);
}

/** Whether the group of an MCM is an order of passing: then its sender accepts its own request. */
function hasOrder(own, { answers }) {
  return answers.some(([station, yes]) => station === own && yes);
}

/** Requests, answers and group of an MCM in words; "" if there are none. */
function bargain(own, { requests, answers, group }) {
  const asks = wishes(own, requests).map((wish) => `asks ${wish}`);
  const others = answers.filter(([station]) => station !== own);
  const says = others.map(([station, yes]) => (yes ? `agrees with ${station}` : `refuses ${station}`));
  const word = hasOrder(own, { answers }) ? "order of passing" : "in conflict";
  const sees = group.length ? [`${word}: ${group.join(", ")}`] : [];
  return [...asks, ...says, ...sees].join("\n");
}

/** The columns of a table as arrays. */
function rowsOf(flat, columns) {
  const height = columns ? flat.length / columns : 0;
  return Array.from({ length: columns }, (_, i) => Array.from({ length: height }, (_, j) => flat[j * columns + i]));
}

function push(map, key, value) {
  if (!map.has(key)) map.set(key, []);
  map.get(key).push(value);
}

/** How many of the entries, sorted by tick, are at or before the time. */
function countAtOrBefore(sorted, time) {
  let low = 0;
  let high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle].tick <= time) low = middle + 1;
    else high = middle;
  }
  return low;
}
