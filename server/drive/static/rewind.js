// While the drive stands: drag the time of a take, drive on from there, look what agents would do.

const WHAT_IF_S = 5;
const GHOST_COLOURS = ["#7a5be0", "#e0701a", "#12946b", "#b83fa6", "#0f93b5", "#c93a4b", "#8a7a12", "#2f6bed"];

class Rewind {
  constructor(page) {
    this.page = page;
    this.motions = new MotionStore(page.token);
    this.tree = new TakeTree((take) => this.choose(take));
    this.ghosts = [];
    this.isScrubbing = false;
    this.isOpen = false;
    $("time").addEventListener("input", () => this.seek(Number($("time").value)));
    $("do-branch").addEventListener("click", () => this.branch());
    $("do-resume").addEventListener("click", () => this.resume());
    $("do-finish").addEventListener("click", () => page.connection.ask({ do: "finish" }));
    addEventListener("resize", () => this.isOpen && this.show());
  }

  get agent() {
    return $("set-agent").value || undefined;
  }

  // ---- what the server tells

  takeTree(takes) {
    if (this.isOpen) {
      this.load();
      this.show();
    }
    for (const number of this.motions.motions.keys()) if (!takes.some((take) => take.number === number)) this.motions.motions.delete(number);
  }

  /** Another take goes on: after a rewind, or because somebody else went back. */
  beginTake(take) {
    this.shown = take;
    this.isScrubbing = false;
    if (this.isOpen) this.close();
    if (this.isWaiting) this.page.showReady();
    this.isWaiting = false;
  }

  stopAsking() {
    this.isWaiting = this.isAsking = false;
    if (this.isOpen) this.show();
  }

  takeGhosts({ take, tick, ghosts }) {
    this.ghostsOf = { take, tick };
    this.isAsking = false;
    $("notice").hidden = true;
    const agents = [...new Set(ghosts.map(({ agent }) => agent))];
    this.ghosts = ghosts.map((ghost) => ({ ...ghost, colour: GHOST_COLOURS[agents.indexOf(ghost.agent) % GHOST_COLOURS.length] }));
    this.showGhosts();
    this.show();
  }

  // ---- the panel

  open() {
    const { page } = this;
    this.isOpen = true;
    this.shown ??= page.take;
    this.isScrubbing = false;
    this.tick = page.tick;
    $("rewind").hidden = false;
    this.show();
    this.load();
    if (page.isDriver) $("do-resume").focus({ preventScroll: true });
  }

  close() {
    this.isOpen = false;
    this.isScrubbing = false;
    $("rewind").hidden = true;
    $("ghosts").hidden = true;
    this.shown = this.page.take;
  }

  get shownTake() {
    return this.page.takes.find(({ number }) => number === this.shown);
  }

  /** A take that has just ended has no motion until it is stored, with its score. */
  get isBeingStored() {
    const take = this.shownTake;
    return this.page.state === "finished" && take?.score === null && take.status !== "void";
  }

  /** The take that goes on has come as far as the picture; one that was ended early is finished without its person, to its own end. */
  get lastTick() {
    const { page } = this;
    const take = this.shownTake;
    if (this.shown !== page.take) return take?.end_tick ?? 0;
    return take?.status === "finished" ? Math.max(page.tick, take.end_tick) : page.tick;
  }

  /** Nobody drives on from the end of a take, nor after its person has left it. */
  get mayBranch() {
    const take = this.shownTake;
    if (!take) return false;
    if (typeof take.left_tick === "number") return this.tick <= take.left_tick;
    const isOver = take.status === "finished" || (take.number === this.page.take && this.page.state === "finished");
    return this.tick <= this.lastTick - (isOver ? 1 : 0);
  }

  get whyNot() {
    const left = this.shownTake?.left_tick;
    if (typeof left !== "number") return "this is its end";
    return `nobody drove after ${formatTime(left * this.page.welcome.tick_s)}`;
  }

  choose(take) {
    this.shown = take;
    this.seek(take === this.page.take ? this.page.tick : Math.min(this.tick, this.lastTick));
  }

  async load() {
    const { shown, lastTick } = this;
    if (this.motions.get(shown)?.ticks >= lastTick || this.isLoading || this.isBeingStored) return;
    this.isLoading = true;
    try {
      await this.motions.load(shown, lastTick - 1);
      this.show();
    } catch (error) {
      this.page.tell(error.message);
    } finally {
      this.isLoading = false;
    }
    if (this.shown !== shown || this.lastTick !== lastTick) this.load(); // the take has grown, or another one is shown
  }

  seek(tick) {
    this.tick = Math.min(Math.max(tick, 0), this.lastTick);
    this.isScrubbing = this.shown !== this.page.take || this.tick !== this.page.tick;
    if (this.isScrubbing && this.page.card.shown === "end") this.page.card.hide();
    this.load();
    this.show();
  }

  show() {
    const { page } = this;
    const seconds = (tick) => formatTime(tick * page.welcome.tick_s);
    $("time").max = this.lastTick;
    $("time").value = this.tick;
    $("time").setAttribute("aria-valuetext", `${(this.tick * page.welcome.tick_s).toFixed(1)} seconds`);
    setText($("time-now"), seconds(this.tick));
    setText($("time-end"), seconds(this.lastTick));
    const take = this.shownTake;
    const words = take ? describeTake(take, page.welcome.cav) : [];
    if (page.isDriver && this.isScrubbing && !this.mayBranch) words.push(this.whyNot);
    setText($("shown-take"), words.join(" · "));
    this.tree.draw(page.takes, this.shown, page.take, page.welcome.cav);
    this.tree.moveCursor(this.tick);
    const isFinished = page.state === "finished";
    $("do-branch").hidden = !page.isDriver || !(this.isScrubbing || (isFinished && this.mayBranch));
    $("do-branch").disabled = !this.mayBranch;
    $("do-branch").title = this.mayBranch ? "" : this.whyNot;
    $("do-finish").hidden = !page.isDriver || this.isScrubbing || isFinished;
    $("do-resume").hidden = !page.isDriver || (isFinished && !this.isScrubbing);
    setText($("do-resume"), this.isScrubbing ? "Back to the present" : "Go on");
    $("do-resume").className = this.isScrubbing ? "second" : "first";
    $("do-what-if").hidden = !page.isDriver || !page.welcome.agents.length;
    $("do-what-if").disabled = Boolean(this.isAsking);
    document.body.dataset.shownTick = this.isScrubbing && !this.motion ? "" : this.tick;
  }

  get motion() {
    const motion = this.motions.get(this.shown);
    return motion && this.tick < motion.ticks ? motion : undefined;
  }

  // ---- what it does

  branch() {
    this.isWaiting = true;
    this.page.connection.ask({ do: "rewind", take: this.shown, tick: this.tick });
  }

  resume() {
    if (this.isScrubbing) {
      this.shown = this.page.take;
      this.seek(this.page.tick);
      return;
    }
    this.page.resume();
  }

  askWhatIf() {
    const { page } = this;
    if (!this.isOpen || !page.isDriver) return page.tell("Pause first (P), then ask what an agent would do.");
    this.isAsking = true;
    this.show();
    page.tell("Agents drive on from here …");
    return page.connection.ask({ do: "what-if", take: this.shown, tick: this.tick, agents: page.welcome.agents, seconds: WHAT_IF_S });
  }

  showGhosts() {
    const own = this.ghosts.filter(({ cav }) => cav === this.page.welcome.cav);
    $("ghosts").hidden = !own.length;
    $("ghosts").replaceChildren(...own.map(({ agent, colour, ending, poses }) => {
      const line = make("li");
      const swatch = make("i");
      swatch.style.background = colour;
      line.append(swatch, make("b", "", agent), ` ${ending ?? "drives on"} after ${(poses.length * this.page.welcome.tick_s).toFixed(1)} s`);
      return line;
    }));
  }

  // ---- pictures

  /** The ghosts in a tick; in the tick of their beginning they drive on again and again. */
  ghostsAt(tick) {
    if (!this.ghosts.length) return NOTHING;
    const { tick: begin } = this.ghostsOf;
    const length = Math.max(...this.ghosts.map(({ poses }) => poses.length));
    let index = tick - begin - 1;
    if (this.isOpen && tick === begin) index = Math.floor(performance.now() / TICK_MS) % (length + 20);
    if (index < 0 || index >= length + 20) return NOTHING;
    return this.ghosts.map((ghost) => this.placeGhost(ghost, Math.min(index, ghost.poses.length - 1))).filter(Boolean);
  }

  placeGhost({ agent, cav, poses, colour }, index) {
    const named = [...this.page.traffic.names.values()].find(({ id }) => id === cav);
    if (!named || !poses.length) return undefined;
    const [x, y, yaw] = poses[index];
    const paint = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
    const label = cav === this.page.welcome.cav ? agent : undefined;
    return { x, y, yaw, colour, paint, label, model: named.model, size: [named.length, named.width, named.height], path: poses };
  }

  /** The picture of the tick that is shown. */
  describe() {
    const { page, motion } = this;
    if (!motion) return {};
    const users = motion.at(this.tick);
    const cav = page.welcome.cav ?? page.watchedCav;
    const own = users.find(({ id }) => id === cav);
    const centre = own ?? users.find(({ id }) => page.routes.has(id)) ?? this.centre;
    this.centre = centre;
    const others = users.filter((user) => user !== own).map((user) => page.colour(user));
    return {
      centre, own: own && page.colour(own), users: others, signals: motion.signalsAt(this.tick),
      overlays: { route: page.routes.get(cav)?.points, ghosts: this.ghostsAt(this.tick) },
    };
  }
}
