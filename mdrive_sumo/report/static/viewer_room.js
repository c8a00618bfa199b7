// Room for the scene: panels fold, and the scene is fitted into the area of the stage that no card covers.

const FIT_MARGIN_PX = 34; // for labels and goals at the edge
const OPEN_LAYERS_PX = 880; // a stage as wide as this has room for the open list of layers
const PANEL_BESIDE_MAP_PX = 860; // up to this width the style sheet puts the panel below the map
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

/** Parts of the stage that neither the list of layers (left) nor camera images (right) cover, in px of the style sheet. */
function freeAreas() {
  const stage = $("stage").getBoundingClientRect();
  const layers = $("layers").getBoundingClientRect();
  const none = { left: stage.right, bottom: stage.top };
  const images = $("cameras");
  const cameras = images && !images.hidden ? images.getBoundingClientRect() : none;
  const area = (left, top, right) => ({ left, top, width: right - left, height: stage.bottom - top });
  return [
    area(layers.right, stage.top, cameras.left),
    area(layers.right, cameras.bottom, stage.right),
    area(stage.left, layers.bottom, cameras.left),
    area(stage.left, Math.max(layers.bottom, cameras.bottom), stage.right),
  ].filter(({ width, height }) => width > 0 && height > 0);
}

/** Puts the middle of the view where the scene can be largest; with `fit` also shows all of it. */
function arrangeScene(viewer, fit) {
  const { view, bounds } = viewer;
  const ratio = devicePixelRatio;
  const room = (area) => [area.width, area.height].map((side) => Math.max((side - 2 * FIT_MARGIN_PX) * ratio, 1));
  const scaleIn = (area) => view.scaleFor(bounds, ...room(area));
  const [area] = freeAreas().sort((a, b) => scaleIn(b) - scaleIn(a));
  if (!area) return; // a window in which nothing can be seen
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
  // Beside another replay the panel lies below the map, and would cover a third of it.
  listenToFold(viewer, "panel-fold", "panel-folded", window.name !== BESIDE || innerWidth > PANEL_BESIDE_MAP_PX);
  const observer = new ResizeObserver(() => viewer.resize());
  for (const card of ["stage", "layers", "cameras"].map($)) if (card) observer.observe(card);
}
