// Links to a time of the replay: the page's own (#t=12.40) and those in the table of cars.
"use strict";

document.addEventListener("DOMContentLoaded", () => {
  const frame = document.getElementById("replay");
  if (!frame) return;
  const page = frame.getAttribute("src");
  const open = () => {
    if (location.hash.startsWith("#t=")) frame.src = page + location.hash;
  };
  // Not before the frame is loaded: a navigation during the first one can get lost.
  if (document.readyState === "complete") open();
  else addEventListener("load", open, { once: true });
  addEventListener("hashchange", open);
  for (const link of document.querySelectorAll('a[target="replay"]')) {
    link.addEventListener("click", (event) => {
      event.preventDefault();
      location.hash = new URL(link.href).hash;
      frame.scrollIntoView({ block: "center" });
    });
  }
});
