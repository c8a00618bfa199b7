// Small helpers of the page.

const $ = (id) => document.getElementById(id);

/** A new element with a class and a text. */
function make(tag, className, text) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  if (text !== undefined) element.textContent = text;
  return element;
}

/** Ids of scenarios are often only numbers. */
function nameCav(id) {
  return /^\d+$/.test(id) ? `CAV ${id}` : id;
}

/** Sets a text only where it changes: writing it anew costs a layout, and screen readers repeat it. */
function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function setPressed(button, isPressed) {
  if (button.getAttribute("aria-pressed") !== String(isPressed)) button.setAttribute("aria-pressed", String(isPressed));
}

function formatTime(seconds) {
  const whole = Math.max(0, seconds);
  return `${Math.floor(whole / 60)}:${(whole % 60).toFixed(1).padStart(4, "0")}`;
}

/** "120 m", "1.2 km": in steps that can be read while driving. */
function formatDistance(metres) {
  if (metres >= 1000) return `${(metres / 1000).toFixed(1)} km`;
  const step = metres >= 100 ? 10 : metres >= 20 ? 5 : 1;
  return `${Math.max(0, Math.round(metres / step) * step)} m`;
}

/** What is kept in the browser under a name; `fallback` if nothing is, or if the browser keeps nothing. */
function recall(name, fallback) {
  try {
    return JSON.parse(localStorage.getItem(`mdrive-sumo drive ${name}`)) ?? fallback;
  } catch {
    return fallback;
  }
}

function keep(name, value) {
  try {
    localStorage.setItem(`mdrive-sumo drive ${name}`, JSON.stringify(value));
  } catch {
    // a private window keeps nothing: the setting counts until the page is closed
  }
}

/** Colours of the theme: the same custom properties as the style sheet. */
function readTheme() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ground", "road", "apron", "line", "footway", "building", "building-edge", "vehicle", "vehicle-edge", "cyclist", "pedestrian",
    "static", "ink", "muted", "halo", "good", "warn", "bad", "card", "focus", "cpm", "mcm", "text"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}
