// The own route: how far it is to the goal, and what to do next.

const TURN_RAD = 0.6; // 34 degrees within TURN_SPAN_M count as a turn, less as a bend of the road
const TURN_SPAN_M = 25;
const U_TURN_RAD = 2.6;
const SEARCH_M = 40; // the car is looked for so far before and after its last place on the route
const SAME_TURN_M = 10; // two turns to the same side so near are one
const PREVIEW_S = 0.15; // the steering answers after about so long: 0.08 s lag, a tick, and its rate
const CHORD_M = 1.5; // half of the piece of the route that gives its direction: points are a metre apart
const ASIDE_GAIN = 2.5; // 1/s: tried 1 to 4 on a turn of 14 m radius at 7 m/s; less leaves the lane, more is not better
const LOST_M = 25; // farther from the route, all of it is searched

class Route {
  /** `points`: [[x, y], ...] [m]; `limits`: speed limit at each point [m/s], if known. */
  constructor(points, limits = []) {
    this.points = points.filter((point, i) => !i || Math.hypot(point[0] - points[i - 1][0], point[1] - points[i - 1][1]) > 1e-6);
    this.limits = limits.length === points.length ? limits : [];
    this.marks = [0];
    for (let i = 1; i < this.points.length; i++) this.marks.push(this.marks[i - 1] + this.lengthOf(i - 1));
    this.manoeuvres = this.findTurns();
    this.forget();
  }

  forget() {
    this.place = undefined;
  }

  get length() {
    return this.marks.at(-1);
  }

  lengthOf(i) {
    const [a, b] = [this.points[i], this.points[i + 1]];
    return Math.hypot(b[0] - a[0], b[1] - a[1]);
  }

  /** Index of the segment at a place [m along the route]. */
  segmentAt(place) {
    let [low, high] = [0, this.points.length - 2];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.marks[middle] <= place) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  pointAt(place) {
    const i = this.segmentAt(Math.min(Math.max(place, 0), this.length));
    const share = (Math.min(Math.max(place, 0), this.length) - this.marks[i]) / (this.lengthOf(i) || 1);
    const [a, b] = [this.points[i], this.points[i + 1] ?? this.points[i]];
    return [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share];
  }

  directionAt(place) {
    const i = this.segmentAt(Math.min(Math.max(place, 0), this.length));
    const [a, b] = [this.points[i], this.points[i + 1] ?? this.points[i]];
    return Math.atan2(b[1] - a[1], b[0] - a[0]);
  }

  /** The place [m] on the route nearest to a point, near the last one; remembers it. */
  locate(x, y) {
    let best = this.place === undefined ? this.nearest(x, y, 0, this.length) : this.nearest(x, y, this.place - SEARCH_M, this.place + SEARCH_M);
    if (best.apart > LOST_M) best = this.nearest(x, y, 0, this.length);
    this.place = best.place;
    return best;
  }

  nearest(x, y, from, to) {
    let best = { place: 0, apart: Infinity };
    for (let i = this.segmentAt(Math.max(from, 0)); i < this.points.length - 1 && this.marks[i] <= to; i++) {
      const [ax, ay] = this.points[i];
      const [dx, dy] = [this.points[i + 1][0] - ax, this.points[i + 1][1] - ay];
      const share = Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)));
      const apart = Math.hypot(ax + dx * share - x, ay + dy * share - y);
      if (apart < best.apart) best = { place: this.marks[i] + share * this.lengthOf(i), apart };
    }
    return best;
  }

  /** Speed limit [m/s] at a place; undefined if unknown. */
  limitAt(place) {
    return this.limits[Math.min(this.segmentAt(place), this.limits.length - 1)];
  }

  /** The next manoeuvre after a place: {kind: left|right|turn-round|goal, from, to} [m]; to the end of a turn it is that one. */
  nextAfter(place) {
    return this.manoeuvres.find(({ to }) => to > place) ?? { kind: "goal", from: this.length, to: this.length };
  }

  /** Where the heading changes by TURN_RAD or more within TURN_SPAN_M. */
  findTurns() {
    const turns = [];
    const step = 1;
    let place = 0;
    while (place < this.length - step) {
      const span = Math.min(TURN_SPAN_M, this.length - place);
      if (Math.abs(this.turnBetween(place, place + span)) < TURN_RAD) place += step;
      else {
        const turn = this.turnFrom(place, step);
        const last = turns.at(-1);
        if (last && Math.sign(last.angle) === Math.sign(turn.angle) && turn.from - last.to < SAME_TURN_M) {
          Object.assign(last, { to: turn.to, angle: last.angle + turn.angle });
        } else turns.push(turn);
        place = turn.to + step;
      }
    }
    return turns.map(({ from, to, angle }) => ({ from, to, kind: Math.abs(angle) > U_TURN_RAD ? "turn-round" : angle > 0 ? "left" : "right" }));
  }

  /** The turn that begins within TURN_SPAN_M after a place, with its ends where the heading is steady. */
  turnFrom(place, step) {
    const sign = Math.sign(this.turnBetween(place, Math.min(place + TURN_SPAN_M, this.length)));
    const bends = (at) => at + 2 * step <= this.length && sign * this.turnBetween(at, at + 2 * step) > 0.02;
    let from = place;
    while (from < this.length - step && !bends(from)) from += step;
    let to = from + step;
    while (to < this.length && (bends(to) || bends(to + step) || bends(to + 2 * step))) to += step;
    const angle = this.turnBetween(from, Math.min(to + step, this.length));
    return { angle, from, to: Math.max(to, place + step) };
  }

  /** Change of heading [rad] between two places, left positive, with whole turns. */
  turnBetween(from, to) {
    let total = 0;
    let before = this.directionAt(from);
    for (let i = this.segmentAt(from) + 1; i < this.points.length - 1 && this.marks[i] <= to; i++) {
      const direction = this.directionAt(this.marks[i] + 1e-9);
      total += wrapAngle(direction - before);
      before = direction;
    }
    return total;
  }
}

/**
 * Steering along the route in [-1, 1]: against the errors of heading and place at the front axle, a little ahead of the car for the
 * lag of its steering (Hoffmann and others 2007, "Stanley").
 */
function steerAlong(route, state, vehicle) {
  const speed = Math.max(state.vx, 0);
  const reach = vehicle.wheelbase - vehicle.rear_to_centre;
  const front = [state.x + reach * Math.cos(state.yaw), state.y + reach * Math.sin(state.yaw)];
  const { place } = route.locate(...front);
  const ahead = place + PREVIEW_S * speed;
  const [from, to] = [route.pointAt(ahead - CHORD_M), route.pointAt(ahead + CHORD_M)];
  const heading = wrapAngle(Math.atan2(to[1] - from[1], to[0] - from[0]) - state.yaw);
  const [x, y] = route.pointAt(place);
  const direction = route.directionAt(place);
  const aside = (y - front[1]) * Math.cos(direction) - (x - front[0]) * Math.sin(direction); // m, positive: the route is to the left
  return clampTo(1, (heading + Math.atan((ASIDE_GAIN * aside) / (speed + 2))) / vehicle.max_steer_angle);
}
