// Speed, limit, pedals, wheel, and the card that guides along the route.

const KMH = 3.6; // km/h in a m/s
const OVER_KMH = 3; // so much over the limit turns the number red
const NOW_M = 12; // nearer than this a manoeuvre is "now"
const ARROWS = {
  left: "M32 42V24q0-6-6-6H16m7-8-9 8 9 8",
  right: "M16 42V24q0-6 6-6h10m-7-8 9 8-9 8",
  "turn-round": "M32 42V22a8 8 0 0 0-16 0v14m-7-6 7 8 7-8",
  ahead: "M24 42V10m-9 9 9-10 9 10",
  goal: "M15 42V8m0 2h20l-5 7 5 7H15",
};
const NAMES = { left: "Turn left", right: "Turn right", "turn-round": "Turn round", goal: "Goal" };
const FAR_M = 250; // a manoeuvre farther away: the road goes on until then

class Instruments {
  constructor() {
    this.wheel = $("wheel").firstElementChild;
    this.pedals = { throttle: $("pedal-throttle").firstElementChild, brake: $("pedal-brake").firstElementChild };
  }

  /** `control`: of this moment, so that a key is seen at once. */
  show(state, control, device, limit) {
    const kmh = Math.max(0, state.vx) * KMH;
    setText($("speed"), String(Math.round(kmh)));
    $("limit").hidden = limit === undefined;
    if (limit !== undefined) {
      setText($("limit").firstElementChild, String(Math.round(limit * KMH)));
      $("instruments").classList.toggle("over", kmh > limit * KMH + OVER_KMH);
    }
    this.wheel.style.transform = `rotate(${(-control.steer * 220).toFixed(1)}deg)`;
    for (const [name, bar] of Object.entries(this.pedals)) bar.style.transform = `scaleY(${control[name].toFixed(3)})`;
    setText($("device"), device);
  }

  guide(route, place) {
    $("guide").hidden = !route;
    if (!route) return;
    const next = route.nextAfter(place);
    const distance = Math.max(0, next.from - place);
    const kind = distance > FAR_M ? "ahead" : next.kind;
    $("guide-arrow").firstElementChild.setAttribute("d", ARROWS[kind]);
    setText($("guide-text"), kind === "ahead" ? "Go straight" : NAMES[kind]);
    setText($("guide-distance"), distance < NOW_M && kind !== "goal" ? "now" : formatDistance(distance));
    setText($("guide-rest"), kind === "goal" ? "" : `${formatDistance(Math.max(0, route.length - place))} to the goal`);
  }
}
