// The 3-D view of the selected CAV. Its script and its scene lie packed in the page until the button is pressed.

const MODES_3D = { chase: "Chase", driver: "Driver", mirrors: "Mirrors", four: "Cameras" };

class Space {
  constructor(replay, talk, changed) {
    Object.assign(this, { replay, talk, changed, isOn: false, mode: "chase", hasFolded: false, pose: {} });
    this.looks = replay.looks.map(([model, paint, height], i) => (
      { model, paint: i < replay.egos ? fromHex(colourOf(i)) : paint, size: [...replay.sizes[i], height] }
    ));
    this.routes = replay.routes.map(pairs);
    this.here = new Set(); // road users that the view has
    this.letters = {};
    new ResizeObserver(() => this.resize()).observe($("space"));
  }

  toggle() {
    this.show3D(!this.isOn, this.mode);
  }

  /** The next mode; the first key shows the view. */
  cycleMode() {
    const modes = Object.keys(MODES_3D);
    this.show3D(true, this.isOn ? modes[(modes.indexOf(this.mode) + 1) % modes.length] : this.mode);
  }

  /** Shows or hides the view; the map stays below it. */
  show3D(isOn, mode) {
    this.isOn = isOn && !this.trouble;
    this.mode = mode;
    $("space").hidden = !this.isOn && !this.trouble;
    document.body.classList.toggle("in-3d", this.isOn);
    pressed($("toggle-3d"), this.isOn);
    setText($("view-mode"), MODES_3D[mode]);
    this.foldLayers();
    if (this.isOn && !this.loading) this.loading = this.load().catch((error) => this.fail(error));
    this.changed();
  }

  /** The open list of layers would cover the view; it opens again with the map. */
  foldLayers() {
    const isOpen = $("layers-fold").getAttribute("aria-expanded") === "true";
    if (this.isOn === this.hasFolded) return;
    if (this.isOn ? isOpen : this.isUnfolded) $("layers-fold").click();
    this.isUnfolded = this.isOn && isOpen;
    this.hasFolded = this.isOn;
  }

  async load() {
    const script = document.createElement("script"); // the content policy of the page names the hash of this text
    script.textContent = new TextDecoder().decode(await unpack($("view-3d-script")));
    document.head.append(script);
    const scene = await decodeScene(await unpack($("scene")));
    this.view = new View3D($("view-3d"), scene, { weather: this.replay.weather });
    this.resize();
  }

  /** Says in one sentence what is missing; the map stays. */
  fail(error) {
    this.trouble = true;
    $("no-3d").textContent = error.message;
    $("no-3d").hidden = false;
    $("space").classList.add("without");
    $("toggle-3d").disabled = true;
    this.show3D(false, this.mode);
  }

  resize() {
    if (!this.view || !this.isOn) return;
    this.view.resize($("space").clientWidth, $("space").clientHeight);
    this.drawn = undefined;
    this.changed();
  }

  /** Draws what the selected CAV is in the middle of. Returns true if that must be tried again. */
  show(viewer) {
    if (!this.isOn || !this.view) return false;
    const key = [viewer.time, viewer.selected, this.mode, [...viewer.on]].join();
    if (key === this.drawn) return false;
    if (!this.view.isReady()) return true;
    this.drawn = key;
    this.placeAll(viewer.time);
    this.showSignals(Math.floor(viewer.time));
    this.view.setOverlays(this.listOverlays(viewer));
    this.view.look({ ...this.findEye(viewer), mode: this.mode, own: viewer.selected });
    this.view.draw(this.replay.seconds(viewer.time));
    return false;
  }

  /** The pose of the selected CAV, its last one after it has left the world, or the start of its route. */
  findEye({ selected, time }) {
    if (this.replay.sample(selected, time, this.pose)) {
      this.eye = { ...this.pose };
    } else if (!this.eye || this.followed !== selected) {
      const [[x, y], [nextX, nextY]] = this.routes[selected];
      this.eye = { x, y, yaw: Math.atan2(nextY - y, nextX - x) };
    }
    this.followed = selected;
    return this.eye;
  }

  placeAll(time) {
    const { replay, view, pose } = this;
    const columns = replay.columns.lamps;
    const column = Math.floor(time / replay.lamps_every);
    this.looks.forEach(({ model, paint, size }, i) => {
      if (replay.sample(i, time, pose)) {
        view.place(i, model, paint, size, pose.x, pose.y, pose.yaw, replay.tables.lamps[i * columns + column]);
        this.here.add(i);
      } else if (this.here.delete(i)) view.remove(i);
    });
  }

  showSignals(tick) {
    const { replay, letters } = this;
    for (const [tls, changes] of replay.changesOf) {
      const state = lastAtOrBefore(changes, tick)?.state;
      if (state !== undefined) letters[tls] = state;
    }
    this.view.setSignals(letters);
  }

  /** The route of the selected CAV and, where their layers are on, intentions and shared objects. */
  listOverlays({ selected, on, time }) {
    const tick = Math.floor(time);
    const { replay, talk } = this;
    const isInside = this.mode === "driver" || this.mode === "mirrors"; // the own ribbon would lie on the own bonnet
    const tellers = on.has("intentions") ? [...Array(replay.egos).keys()].filter((ego) => !isInside || ego !== selected) : [];
    const intentions = tellers.flatMap((ego) => this.listIntention(ego, tick));
    const shared = on.has("shared") ? talk.received(selected, tick).flatMap((message) => this.listShared(message)) : [];
    return { route: this.routes[selected], intentions, shared };
  }

  listIntention(ego, tick) {
    const content = this.talk.newest("mcm", ego, tick, (message) => message.content?.planned.length)?.content;
    return content && this.replay.present(ego, tick) ? [{ path: content.planned, colour: colourOf(ego), from: shortened(this.replay.ids[ego]) }] : [];
  }

  listShared({ from, content }) {
    const isCav = from < this.replay.egos;
    const told = { colour: isCav ? colourOf(from) : "#9aa4b2", from: shortened(this.talk.stations[from]) };
    return content.objects.map(({ x, y, yaw, length, width }) => ({ x, y, yaw, length, width, ...told }));
  }
}

async function unpack(block) {
  const packed = Uint8Array.from(atob(block.textContent.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

function fromHex(colour) {
  return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
}
