// Complements HTML and HTMX. Every page works without it.
"use strict";

// Copies `data-status` of a swapped part into the status line, which screen readers announce.
const say = (text) => {
  const place = document.getElementById("status");
  if (place && place.textContent !== text) place.textContent = text;
};

document.addEventListener("htmx:afterSettle", (event) => {
  const found = event.detail.elt.closest("[data-status]") || event.detail.elt.querySelector("[data-status]");
  if (found) say(found.dataset.status);
});
document.addEventListener("htmx:sendError", () => say("The server does not answer. Try again in a moment."));
document.addEventListener("htmx:responseError", (event) => {
  const page = new DOMParser().parseFromString(event.detail.xhr.responseText, "text/html");
  say(page.querySelector(".problem")?.textContent || `The server answered with an error (${event.detail.xhr.status}).`);
});

// Selects the text of fields to copy from.
for (const field of document.querySelectorAll("[data-select]")) {
  field.addEventListener("focus", () => field.select());
}
