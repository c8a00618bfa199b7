// Pause, scrub over a take, drive on from any of its ticks.

class Rewind {
  constructor(page) {
    this.page = page;
    this.isScrubbing = false;
  }

  takeTree() {}
  beginTake() {}
  takeGhosts() {}
  ghostsAt() {
    return [];
  }
  askWhatIf() {}
  open() {
    this.page.card.show({ key: "paused", title: "Paused", actions: this.page.isDriver ? [["Go on", () => this.page.resume()]] : [] });
  }
  close() {}
}
