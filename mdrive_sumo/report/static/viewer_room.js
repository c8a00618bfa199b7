// Room for the scene: panels fold, and the scene is fitted into the area of the stage that no card covers.

const FIT_MARGIN_PX = 34; // for labels and goals at the edge
const OPEN_LAYERS_PX = 880; // a stage as wide as this has room for the open list of layers
const PLACES_EVERY_TICKS = 20;

/** [x0, y0, x1, y1] around all routes and all places of the CAVs [m]. */
function sceneBounds(replay) {
  const pose = {};
  let bounds = [Infinity, Infinity, -Infinity, -Infinity];
  const add = ([x, y]) => {
    bounds = [Math.min(bounds[0], x), Math.min(bounds[1], y), Math.max(bounds[2], x), Math.max(bounds[3], y)];
  };
  replay.routes.flatMap(pairs).forEach(add);
  for (let ego = 0; ego < replay.egos; ego++) {
    for (let tick = 0; tick < replay.ticks; tick += PLACES_EVERY_TICKS) if (replay.sample(ego, tick, pose)) add([pose.x, pose.y]);
  }
  return bounds;
}

/** Parts of the stage beside and below the list of layers: { left, top, width, height } in px of the style sheet. */
function freeAreas() {
  const stage = $("stage").getBoundingClientRect();
  const card = $("layers").getBoundingClientRect();
  const below = { left: stage.left, top: card.bottom, width: stage.width, height: stage.bottom - card.bottom };
  const beside = { left: card.right, top: stage.top, width: stage.right - card.right, height: stage.height };
  return [beside, below];
}

/** Puts the middle of the view where the scene can be largest; with `fit` also shows all of it. */
function arrangeScene(viewer, fit) {
  const { view, bounds } = viewer;
  const ratio = devicePixelRatio;
  const room = (area) => [area.width, area.height].map((side) => Math.max((side - 2 * FIT_MARGIN_PX) * ratio, 1));
  const scaleIn = (area) => view.scaleFor(bounds, ...room(area));
  const [best, other] = freeAreas().sort((a, b) => scaleIn(b) - scaleIn(a));
  const area = best.width > 0 && best.height > 0 ? best : other;
  view.middleX = Math.round((area.left + area.width / 2) * ratio);
  view.middleY = Math.round((area.top + area.height / 2) * ratio);
  viewer.stage = { width: area.width * ratio, height: area.height * ratio };
  if (fit) view.fit(bounds, ...room(area));
}

/** The button folds and unfolds what it controls. */
function listenToFold(viewer, id, className, isOpen) {
  const button = $(id);
  const set = (open) => {
    document.body.classList.toggle(className, !open);
    button.setAttribute("aria-expanded", open);
    viewer.resize();
  };
  set(isOpen);
  button.addEventListener("click", () => set(document.body.classList.contains(className)));
}

function listenToFolds(viewer) {
  listenToFold(viewer, "layers-fold", "layers-folded", $("stage").clientWidth >= OPEN_LAYERS_PX);
  listenToFold(viewer, "panel-fold", "panel-folded", true);
  const observer = new ResizeObserver(() => viewer.resize());
  for (const id of ["stage", "layers"]) observer.observe($(id));
}
