// The page: connects, reads inputs, predicts, draws. One global, `Drive`, for tests and measurements.

const LONGEST_STEP_S = 0.1; // after a pause of the browser the keys go on from here, they do not jump
const RUNNING = new Set(["running", "slow"]);
const FLYING_SPEED = 12; // m/s: a picture without own car is laid out as for this speed
const SELF_M = 3; // what others share so near, and in this direction, is the own car as they saw it ...
const SELF_S = 0.3; // ... up to so long ago
const SELF_RAD = 0.4;
const KEPT_TIMES = 600;
const NOTICE_MS = 4500;

class DrivePage {
  constructor() {
    const tell = (text, isQuiet) => this.tell(text, isQuiet);
    this.token = new URLSearchParams(location.search).get("token") ?? "";
    this.inputs = new Inputs(tell);
    this.clock = new InputClock();
    this.traffic = new Traffic();
    this.exchange = new Exchange();
    this.picture = new Picture(tell);
    this.instruments = new Instruments();
    this.card = new Card();
    this.collisions = new CollisionNotice();
    this.chat = new Chat((text) => this.connection.ask({ do: "say", text }), () => document.activeElement?.blur());
    this.signals = {};
    this.endings = {};
    this.drivers = {};
    this.number = 0; // of the newest input
    this.pictures = 0; // large ones that were drawn
    this.frameTimes = []; // ms between them
    this.keyTimes = []; // ms from a key to the picture that shows it
    this.showsV2x = recall("v2x", true);
    this.spectated = 0;
    listenToCommands(this);
    this.setMode("connecting");
    this.card.show({ key: "connecting", title: "Connecting …" });
    this.connect();
    requestAnimationFrame((now) => this.animate(now));
  }

  connect() {
    const address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket?token=${encodeURIComponent(this.token)}`;
    this.connection = new Connection(address, {
      open: () => this.startAnew(),
      frame: (frame) => this.takeFrame(frame, performance.now()),
      message: (message) => this.takeMessage(message),
      lost: (seconds) => this.showLost(seconds),
      closed: (sentence) => this.showClosed(sentence),
    });
  }

  setMode(mode) {
    this.mode = mode;
    document.body.dataset.mode = mode;
  }

  /** A sentence for the person, which goes away by itself. */
  tell(text, isQuiet = false) {
    $("notice").hidden = false;
    $("notice").classList.toggle("quiet", isQuiet);
    setText($("notice"), text);
    clearTimeout(this.noticeTimer);
    this.noticeTimer = setTimeout(() => ($("notice").hidden = true), isQuiet ? NOTICE_MS / 3 : NOTICE_MS);
  }

  // ---- messages

  /** Inputs are numbered anew on each connection. */
  startAnew() {
    this.number = 0;
    this.clock.forget();
    this.prediction?.forget();
  }

  takeMessage(message) {
    const takers = {
      welcome: () => this.takeWelcome(message),
      tree: () => this.takeTree(message),
      waiting: () => this.takeWaiting(message),
      ghosts: () => this.rewind.takeGhosts(message),
      problem: () => this.takeProblem(message),
      notice: () => this.tell(message.text),
    };
    takers[message.is]?.();
  }

  /** What was refused is asked for no longer. */
  takeProblem({ text }) {
    this.rewind?.stopAsking();
    this.tell(text);
  }

  takeWelcome(welcome) {
    const isFirst = !this.welcome;
    this.welcome = welcome;
    this.origin = welcome.origin;
    this.isDriver = welcome.role === "driver";
    this.prediction = new Prediction(welcome.vehicle);
    this.routes = new Map(Object.entries(welcome.routes).map(([cav, points]) => [cav, new Route(points, cav === welcome.cav ? welcome.speed_limits : [])]));
    if (this.isDriver && !this.routes.has(welcome.cav)) this.routes.set(welcome.cav, new Route(welcome.route, welcome.speed_limits));
    this.stations = new Map(Object.entries(welcome.pseudonyms ?? {}).map(([id, pseudonym]) => [pseudonym, id]));
    $("set-agent").replaceChildren(...welcome.agents.map((agent) => make("option", "", agent)));
    this.drivers = Object.fromEntries(welcome.cavs.map(({ id, driver }) => [id, driver]));
    document.body.classList.toggle("spectator", !this.isDriver);
    $("do-v2x").hidden = !welcome.v2x_view;
    $("do-chat").hidden = !welcome.chat || !this.isDriver;
    $("set-agent").parentElement.hidden = !this.mayHandOver;
    $("instruments").hidden = false;
    setText($("scenario"), this.title);
    document.title = `${welcome.cav ? nameCav(welcome.cav) : "watching"} · ${this.title} · mdrive-sumo`;
    this.rewind ??= new Rewind(this);
    this.takeTree(welcome);
    if (isFirst) this.loadScene();
    this.setMode(isFirst ? "start" : "ready");
    if (!this.isDriver) this.card.hide();
    else if (isFirst) this.showStart();
    else this.showReady("Connected again");
  }

  async loadScene() {
    try {
      const response = await fetch(`/scene?token=${encodeURIComponent(this.token)}`);
      if (!response.ok) throw new Error(`The scene is not there: the server answers ${response.status}. The top view drives as well.`);
      this.picture.build(await decodeScene(await response.arrayBuffer()), this.welcome.weather);
    } catch (error) {
      this.picture.withoutWebGL(error);
    }
    document.body.dataset.scene = this.picture.view3d ? "3d" : "top";
  }

  takeTree({ takes, current }) {
    this.listed = takes;
    this.current = current ?? this.current;
    this.rewind.takeTree(takes);
    if (this.card.shown === "end") this.showEnd();
  }

  /** The takes; the one that goes on has come as far as the newest frame. */
  get takes() {
    return this.listed.map((take) => (take.number === this.take && take.score === null ? { ...take, end_tick: Math.max(this.tick, take.tick) } : take));
  }

  /** The clock waits for these CAVs' drivers. Of the own one nothing is said: its person sees the button. */
  takeWaiting({ for: cavs, absent, seconds }) {
    const others = cavs.filter((cav) => cav !== this.welcome.cav);
    if (!others.length || this.mode === "driving") {
      if (this.card.shown === "waiting") this.card.hide();
      return;
    }
    if (cavs.length > others.length || this.state === "finished") return;
    const lines = others.map((cav) => paragraph(`${nameCav(cav)}: ${absent.includes(cav) ? "not connected" : "not ready yet"}`));
    if (seconds !== null && seconds !== undefined) lines.push(paragraph(`Who is lost has ${Math.ceil(seconds)} s to come back.`, "muted"));
    this.setMode("waiting");
    this.card.show({ key: "waiting", title: "Waiting for others", body: lines });
  }

  takeFrame(frame, now) {
    const { tick, take, state, ack, own, extra } = frame;
    if (take !== this.take || tick < this.tick) this.beginTake(take, tick);
    const isNew = tick !== this.lastFrame?.tick || take !== this.lastFrame.take;
    Object.assign(this, { tick, take, state, lastFrame: frame, lastFrameAt: now });
    Object.assign(document.body.dataset, { tick, take, state, ack });
    this.takeExtra(extra, tick);
    if (isNew) this.traffic.take(frame);
    this.own = own;
    if (own && this.prediction) this.prediction.acknowledge(ack, own);
    if (RUNNING.has(state)) this.run(now, isNew, ack);
    else if (state === "finished") this.finish();
    else this.stand();
  }

  beginTake(take, tick) {
    this.traffic.forget();
    this.exchange.forget();
    this.clock.forget();
    this.prediction?.forget(this.number);
    this.endings = {};
    this.collisions.hide();
    this.score = undefined;
    for (const route of this.routes?.values() ?? []) route.forget();
    const isOther = take !== this.take;
    Object.assign(this, { take, tick });
    if (isOther) this.rewind?.beginTake(take);
  }

  takeExtra({ names, signals, messages, collisions, endings, drivers, factor, score }, tick) {
    if (names) this.traffic.learn(names);
    if (signals) Object.assign(this.signals, signals);
    if (endings) this.takeEndings(endings);
    if (drivers) this.takeDrivers(drivers);
    if (score) this.score = score;
    if (messages) this.hear(messages, tick);
    if (collisions) this.collisions.tell(collisions, this.welcome);
    if (factor !== undefined) this.factor = factor;
  }

  /** Whose car an agent drives sees it as any other; after a hand-over the prediction begins anew. */
  takeDrivers(drivers) {
    Object.assign(this.drivers, drivers);
    this.prediction?.forget(this.number);
    this.clock.forget();
  }

  takeEndings(endings) {
    Object.assign(this.endings, endings);
    const own = endings[this.welcome.cav];
    if (!own) return;
    if (this.welcome.return_path) this.showEnd(); // a study need not wait for the others
    else this.tell(`Your drive has ended: ${own}. The others go on until the take is finished.`);
  }

  /** Messages name stations by their pseudonyms; people read the ids of the scenario. */
  hear(messages, tick) {
    const named = messages.map((message) => ({ ...message, from: this.stations.get(message.from) ?? message.from }));
    const heard = named.filter(({ from }) => from !== this.welcome.cav);
    for (const { from, text } of this.exchange.take(heard, tick)) this.chat.add(nameCav(from), text);
  }

  run(now, isNew, ack) {
    if (this.mode !== "driving") {
      this.setMode("driving");
      this.card.hide();
      this.rewind.close();
    }
    if (isNew) this.clock.noteFrame(now);
    if (isNew && this.canDrive && this.clock.isDueByFrame(now, this.prediction.waiting, ack)) this.sendInput(now);
  }

  stand() {
    if (this.mode !== "driving" && !(this.mode === "start" && !this.isDriver)) return;
    if (this.own) this.prediction.forget(this.number);
    if (this.own) this.prediction.acknowledge(0, this.own);
    this.setMode("paused");
    this.inputs.release();
    if (this.welcome.may_rewind) this.rewind.open();
    else this.card.show({ key: "paused", title: "Paused", actions: this.isDriver ? [["Go on", () => this.resume()]] : [] });
  }

  finish() {
    if (this.mode === "finished") return;
    this.setMode("finished");
    this.inputs.release();
    if (this.welcome?.may_rewind) this.rewind.open();
    this.showEnd();
  }

  // ---- driving

  get canDrive() {
    return this.isDriver && !this.isAgentDriving && Boolean(this.own) && this.prediction.ready && !this.endings[this.welcome.cav];
  }

  get mayHandOver() {
    return this.isDriver && this.welcome.may_hand_over && this.welcome.agents.length > 0;
  }

  /** Participants of a study are not told what awaits them: scenarios are named after it. */
  get title() {
    return this.welcome.return_path ? "Drive to the goal" : this.welcome.scenario;
  }

  get isAgentDriving() {
    return this.isDriver && (this.drivers[this.welcome.cav] ?? "human") !== "human";
  }

  sendInput(now) {
    this.number += 1;
    this.connection.send(encodeInput(this.inputs.device, this.number, now, this.inputs.control));
    this.prediction.apply(this.number, this.inputs.control);
    this.inputAt = now;
  }

  resume() {
    if (this.mode === "start" || this.mode === "ready") this.setMode("waiting");
    this.card.hide();
    this.connection.ask({ do: "resume" });
  }

  pause() {
    if (!this.isDriver) return;
    if (RUNNING.has(this.state)) this.connection.ask({ do: "pause" });
    else if (this.state === "paused") this.resume();
  }

  /** A page that is hidden draws nothing, and nobody sees the road. */
  leaveWindow() {
    this.inputs.release();
    if (this.canDrive && RUNNING.has(this.state)) this.connection.ask({ do: "pause" });
  }

  handOver() {
    if (!this.mayHandOver) return;
    if (this.endings[this.welcome.cav]) {
      this.tell("Your drive has ended: nobody can take over. Go back (P), and drive on from there.");
      return;
    }
    const to = this.isAgentDriving ? "human" : (this.rewind.agent ?? this.welcome.agents[0]);
    this.connection.ask({ do: "hand-over", cav: this.welcome.cav, to });
    this.tell(to === "human" ? "You drive again." : `${to} drives. Press O to take back.`);
  }

  // ---- pictures

  animate(now) {
    requestAnimationFrame((next) => this.animate(next));
    const elapsed = Math.min((now - (this.before ?? now)) / 1000, LONGEST_STEP_S);
    this.before = now;
    if (this.prediction && this.lastFrame) this.draw(now, elapsed);
  }

  draw(now, elapsed) {
    const began = performance.now();
    const isRunning = this.mode === "driving";
    if (isRunning && this.canDrive) this.advance(began, elapsed);
    const what = this.rewind.isScrubbing ? this.rewind.describe() : this.describe(isRunning);
    if (!what.centre) return;
    if (this.picture.draw(what, began)) this.notePicture(now);
    this.showInstruments(what);
    this.chat.showHeard(what.overlays);
    this.inputs.touch.show();
  }

  /** For measurements: pictures that were drawn, not those that the screen asked for. */
  notePicture(now) {
    this.pictures += 1;
    noteTime(this.frameTimes, now - (this.drawnAt ?? now));
    this.drawnAt = now;
    this.noteKey();
  }

  advance(now, elapsed) {
    this.inputs.read(elapsed, this.shownState ?? this.own, this.welcome.vehicle, this.ownRoute);
    if (this.clock.isDueByTime(now)) this.sendInput(now);
    this.prediction.advance(this.clock.ticksIn(now - (this.inputAt ?? now)), this.clock.ticksIn(1000 * elapsed), elapsed);
  }

  get ownRoute() {
    return this.routes.get(this.welcome.cav);
  }

  /** The picture of this moment: the own car as predicted, the others at the same time. */
  describe(isRunning) {
    const { prediction } = this;
    const state = this.canDrive ? prediction.picture(isRunning ? this.inputs.control : undefined) : this.own;
    const ahead = this.canDrive && isRunning && prediction.shown !== undefined ? prediction.shown - prediction.acknowledged : 0;
    const time = this.tick + (this.canDrive ? ahead : this.sinceFrame());
    const users = this.traffic.at(time);
    const ownRow = users.find(({ id }) => id === this.welcome.cav);
    const others = users.filter((user) => user !== ownRow).map((user) => this.colour(user));
    this.shownState = state && this.toScene(state);
    const own = this.canDrive && ownRow ? { ...ownRow, ...this.shownState, braking: state.brake > 0.05 } : ownRow;
    const centre = own ?? this.spectate(users);
    return {
      centre: centre && { index: centre.index, id: centre.id, x: centre.x, y: centre.y, yaw: centre.yaw, speed: state?.vx ?? centre.speed ?? FLYING_SPEED },
      own: own && this.colour(own), users: others, signals: this.signals, overlays: this.overlays(centre, users), state,
    };
  }

  /** Ticks since the last frame came, where nobody here drives: one tick behind, so that there is a frame to go to. */
  sinceFrame() {
    return RUNNING.has(this.state) ? Math.min(this.clock.ticksIn(performance.now() - (this.lastFrameAt ?? 0)), 1) - 1 : 0;
  }

  toScene(state) {
    return { ...state, x: state.x - this.origin[0], y: state.y - this.origin[1] };
  }

  /** CAVs have colours of their own, so that words and cars go together. */
  colour(user) {
    const colour = this.colourOf(user.id);
    return colour ? { ...user, colour } : user;
  }

  colourOf(cav) {
    const number = this.welcome.cavs.findIndex(({ id }) => id === cav);
    return number < 0 ? undefined : CAV_COLOURS[number % CAV_COLOURS.length];
  }

  get watchedCav() {
    const { cavs } = this.welcome;
    return cavs[this.spectated % cavs.length].id;
  }

  /** The CAV that a spectator watches; while it is not in the world, the picture stays where it was. */
  spectate(users) {
    this.watched = users.find(({ id }) => id === (this.welcome.cav ?? this.watchedCav)) ?? users.find(({ id }) => this.routes.has(id)) ?? this.watched ?? users[0];
    return this.watched;
  }

  overlays(centre, users) {
    const route = this.routes.get(centre?.id ?? this.welcome.cav)?.points;
    const exchange = this.showsV2x && this.welcome.v2x_view ? this.exchange.at(this.tick, users, (cav) => this.colourOf(cav)) : {};
    if (centre && exchange.shared) exchange.shared = exchange.shared.filter((object) => !isSelf(object, centre, this.shownState?.vx ?? 0));
    return { route, ghosts: this.rewind.ghostsAt(this.tick), ...exchange };
  }

  showInstruments({ state, centre }) {
    const isOwn = this.isDriver && centre.id === this.welcome.cav;
    const shown = state ?? { vx: centre.speed };
    const route = this.routes.get(centre.id);
    const place = route?.locate(centre.x, centre.y).place;
    const control = isOwn && this.canDrive && this.mode === "driving" ? this.inputs.control : controlOf(shown, this.welcome.vehicle);
    this.instruments.show(shown, control, this.nameDriver(isOwn, centre), isOwn ? route?.limitAt(place) : undefined);
    this.instruments.guide(route, place);
    this.showStatus();
  }

  /** Who or what drives the car in the picture. */
  nameDriver(isOwn, centre) {
    if (!isOwn) return `watching ${nameCav(centre.id)}`;
    if (this.isAgentDriving) return `${this.drivers[this.welcome.cav]} drives`;
    return this.inputs.isAssisted ? `${this.inputs.device}, assisted` : this.inputs.device;
  }

  showStatus() {
    const words = { driving: "driving", paused: "paused", finished: "finished", waiting: "waiting", start: "ready" };
    setText($("state"), this.take ? `take ${this.take} · ${words[this.mode] ?? this.mode}` : (words[this.mode] ?? this.mode));
    setText($("clock"), this.describeTime());
    const isSlow = this.state === "slow";
    $("pace").hidden = !isSlow;
    if (isSlow) setText($("pace"), `simulation runs at ${(this.factor ?? 1).toFixed(2)} of real time`);
    const { latency } = this.connection;
    setText($("latency"), latency === undefined ? "" : `${latency < 10 ? latency.toFixed(1) : Math.round(latency)} ms`);
    $("latency").classList.toggle("warn", latency > 200);
    const label = RUNNING.has(this.state) ? "Pause" : "Go on";
    setText($("do-pause").lastElementChild, label);
    $("do-pause").hidden = !this.isDriver || this.mode === "finished";
    $("do-agent").hidden = !this.mayHandOver || Boolean(this.endings[this.welcome.cav]);
    document.body.classList.toggle("running", RUNNING.has(this.state));
    setText($("do-agent").lastElementChild, this.isAgentDriving ? "Take back" : "Agent");
  }

  /** The time that is left to the own CAV, or to the one that is watched, or how its drive has ended. */
  describeTime() {
    const { tick_s, most_ticks, time_limit_ticks, cav } = this.welcome;
    const shown = cav ?? this.watchedCav;
    if (this.endings[shown]) return this.endings[shown];
    return `${formatTime(((time_limit_ticks?.[shown] ?? most_ticks) - this.tick) * tick_s)} left`;
  }

  /** Notes how long a key took to the picture. */
  noteKey() {
    if (this.keyAt === undefined) return;
    noteTime(this.keyTimes, performance.now() - this.keyAt);
    document.body.dataset.keys = this.keyTimes.length;
    this.keyAt = undefined;
  }

  // ---- cards

  showStart() {
    this.card.show({ key: "start", title: this.title, body: startBody(this.welcome), actions: [["Start", () => this.resume()]] });
  }

  /** After a rewind: the person gets ready, and a pedal or the button starts. */
  showReady(title = `Take ${this.take} from ${formatTime(this.tick * this.welcome.tick_s)}`) {
    this.setMode("ready");
    const text = "Press a pedal, or the button. Others wait for you.";
    this.card.show({ key: "ready", title, body: [paragraph(text)], actions: [["Go", () => this.resume()]] });
  }

  showLost(seconds) {
    this.setMode("lost");
    this.inputs.release();
    this.card.show({ key: "lost", title: "Connection lost", body: [paragraph(`Trying again for ${seconds} s. The drive waits for you.`)] });
  }

  showClosed(sentence) {
    this.setMode("closed");
    this.card.show({ key: "closed", title: "Not connected", body: [paragraph(sentence)], actions: [["Reload", () => location.reload()]] });
  }

  /** What one can do at the end: a drive of a study leads back to it. */
  listWaysOn() {
    const path = this.welcome?.return_path;
    if (path) return [["Back to the study", () => location.assign(path)]];
    return [["Close", () => this.card.hide()]];
  }

  showEnd() {
    this.card.show({ key: "end", title: "The drive has ended", body: endBody(this, this.endings), actions: this.listWaysOn() });
  }
}

function isSelf(object, own, speed) {
  const apart = Math.hypot(object.x - own.x, object.y - own.y);
  return apart < SELF_M + SELF_S * Math.abs(speed) && Math.abs(wrapAngle(object.yaw - own.yaw)) < SELF_RAD;
}

function noteTime(times, value) {
  times.push(value);
  if (times.length > KEPT_TIMES) times.shift();
}

/** Pedals and wheel as the state of the car tells them: of a car that somebody else drives. */
function controlOf({ drive = 0, brake = 0, steer_angle = 0 }, vehicle) {
  return { throttle: drive, brake, steer: steer_angle / vehicle.max_steer_angle };
}

const Drive = new DrivePage();
globalThis.Drive = Drive;
