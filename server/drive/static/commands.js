// Keys and buttons that do not drive: views, pause, chat, settings.

const PEDALS = new Set(["KeyW", "KeyS", "ArrowUp", "ArrowDown"]); // one of them starts after a rewind

function listenToCommands(page) {
  const { picture, inputs, chat } = page;
  const toggle = (name, target, field, box) => {
    target[field] = !target[field];
    keep(name, target[field]);
    if (box) $(box).checked = target[field];
    picture.resize();
  };
  const commands = {
    1: () => picture.choose("driver"),
    2: () => picture.choose("four"),
    3: () => picture.choose("chase"),
    4: () => picture.choose("top"),
    c: () => picture.next(),
    m: () => toggle("mirrors", picture, "hasMirrors", "set-mirrors"),
    n: () => toggle("map", picture, "hasMap", "set-map"),
    l: () => {
      toggle("assist", inputs, "isAssisted", "set-assist");
      page.tell(inputs.isAssisted ? "Assisted steering along the route is on; you keep the pedals." : "You steer.", true);
    },
    v: () => {
      toggle("v2x", page, "showsV2x");
      setPressed($("do-v2x"), page.showsV2x);
    },
    t: () => page.welcome?.chat && page.isDriver && chat.toggle(),
    p: () => page.pause(),
    o: () => page.handOver(),
    g: () => page.rewind?.askWhatIf(),
    "+": () => picture.top.zoom(1 / 1.3),
    "=": () => picture.top.zoom(1 / 1.3),
    "-": () => picture.top.zoom(1.3),
    "?": () => openDialog(page, "help"),
    Tab: () => (page.spectated += 1),
  };
  const buttons = { pause: "p", view: "c", v2x: "v", chat: "t", agent: "o", help: "?", "what-if": "g" };
  for (const [id, key] of Object.entries(buttons)) $(`do-${id}`).addEventListener("click", () => commands[key]());
  $("do-settings").addEventListener("click", () => openDialog(page, "settings"));
  $("do-leave").addEventListener("click", () => {
    page.connection.ask({ do: "leave" });
    $("settings").close();
  });
  setPressed($("do-v2x"), page.showsV2x);
  listenToKeys(page, commands);
  listenToSettings(page, toggle);
  listenToWindow(page);
  return new CalibrationDialog(inputs.gamepad);
}

function isTyping(event) {
  return event.target.closest?.("input:not([type=checkbox], [type=range]), select, textarea, dialog[open]");
}

function listenToKeys(page, commands) {
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event)) return;
    const isPushed = [" ", "Enter"].includes(event.key) && event.target.closest?.("button, summary");
    if (isPushed || (event.target.type === "range" && event.key.startsWith("Arrow"))) return; // these belong to what has the focus
    const isTab = event.key === "Tab";
    const command = isTab && (page.isDriver || event.target !== document.body) ? undefined : commands[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    const drives = page.isDriver && page.inputs.press(event.code, true); // also before the start: the foot may be on the pedal
    if (drives && page.mode === "ready" && PEDALS.has(event.code)) page.resume();
    if (drives && page.mode === "driving") {
      if (!event.repeat) page.keyAt ??= event.timeStamp;
      event.preventDefault();
    } else if (command && !event.repeat) {
      event.preventDefault();
      command();
    }
  });
  addEventListener("keyup", (event) => page.inputs.press(event.code, false));
}

function listenToSettings(page, toggle) {
  const boxes = { assist: [page.inputs, "isAssisted"], mirrors: [page.picture, "hasMirrors"], map: [page.picture, "hasMap"] };
  for (const [name, [target, field]] of Object.entries(boxes)) {
    $(`set-${name}`).checked = target[field];
    $(`set-${name}`).addEventListener("change", () => toggle(name, target, field));
  }
  const isTouch = recall("touch", matchMedia("(pointer: coarse)").matches);
  const show = () => ($("touch").hidden = !$("set-touch").checked);
  $("set-touch").checked = isTouch;
  if (isTouch) page.inputs.source = page.inputs.touch; // until something else is used
  $("set-touch").addEventListener("change", () => {
    keep("touch", $("set-touch").checked);
    show();
  });
  show();
}

function listenToWindow(page) {
  addEventListener("resize", () => page.picture.resize());
  addEventListener("blur", () => page.inputs.release()); // a key that is let go elsewhere would stay pressed
  document.addEventListener("visibilitychange", () => document.hidden && page.leaveWindow());
  $("map").addEventListener("wheel", (event) => {
    event.preventDefault();
    page.picture.top.zoom(Math.exp(event.deltaY * 0.0016));
  }, { passive: false });
  // After a click with the pointer the keys belong to driving again; after the keyboard's, focus stays visible.
  document.addEventListener("click", (event) => event.detail > 0 && event.target.closest("#tools button, #rewind button")?.blur());
}

function openDialog(page, id) {
  page.inputs.release();
  $(id).showModal();
  $(id).scrollTop = 0; // the focus is on its button, below
}
