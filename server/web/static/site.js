// What HTML and HTMX do not do by themselves. Every page works without it.
"use strict";

// After a part of a page was swapped, says in the status line what its `data-said` says: screen readers read it out.
const say = (text) => {
  const place = document.getElementById("status");
  if (place && place.textContent !== text) place.textContent = text;
};

document.addEventListener("htmx:afterSettle", (event) => {
  const found = event.detail.elt.closest("[data-said]") || event.detail.elt.querySelector("[data-said]");
  if (found) say(found.dataset.said);
});
document.addEventListener("htmx:sendError", () => say("The server does not answer. Try again in a moment."));
document.addEventListener("htmx:responseError", (event) => {
  const page = new DOMParser().parseFromString(event.detail.xhr.responseText, "text/html");
  say(page.querySelector(".problem")?.textContent || `The server answered with an error (${event.detail.xhr.status}).`);
});

// A field that is there to be copied from.
for (const field of document.querySelectorAll("[data-select]")) {
  field.addEventListener("focus", () => field.select());
}
