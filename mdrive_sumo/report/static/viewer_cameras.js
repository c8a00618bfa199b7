// Camera images of the selected CAV, in step with the time. A page without images has no card for them.

class Cameras {
  constructor() {
    const data = $("camera-images");
    this.tracks = data ? JSON.parse(data.textContent) : [];
    if (!data) return;
    this.figures = this.tracks.map((track) => {
      const figure = element("figure", "camera");
      const image = figure.appendChild(element("img", ""));
      image.alt = `Camera ${track.camera}`;
      figure.append(element("figcaption", "", track.camera));
      $("cameras-list").append(figure);
      return { figure, image };
    });
    $("cameras").hidden = false;
    $("cameras-fold").addEventListener("click", () => this.toggle());
  }

  toggle() {
    if (!this.figures) return;
    const open = document.body.classList.toggle("cameras-folded") === false;
    $("cameras-fold").setAttribute("aria-expanded", open);
  }

  /** Shows the last image up to a tick of each camera of a CAV. */
  show(tick, ego) {
    this.tracks.forEach((track, i) => {
      const shown = this.figures[i];
      const latest = track.ego === ego ? lastAtOrBefore(track.images, tick) : undefined;
      shown.figure.hidden = !latest;
      if (!latest || latest === shown.latest) return;
      shown.latest = latest;
      shown.image.src = `data:image/jpeg;base64,${latest.jpeg}`;
    });
  }
}
