// Upload progress, and errors on the form. Without scripts the form works like any other.
"use strict";

document.addEventListener("DOMContentLoaded", () => {
  const form = document.querySelector("form.submit");
  if (!form) return;
  const sending = document.getElementById("sending");
  const bar = document.getElementById("sent");
  const text = document.getElementById("sent-text");
  const refusal = document.getElementById("refusal");
  const archive = document.getElementById("archive");

  const say = (sentence) => {
    const line = document.createElement("p");
    line.className = "problem";
    line.textContent = sentence;
    refusal.replaceChildren(line);
  };

  archive.addEventListener("change", () => {
    const file = archive.files[0];
    const most = Number(archive.dataset.most);
    const long = file && file.size > most;
    archive.setCustomValidity(long ? `expected at most ${most} bytes, found ${file.size}` : "");
    archive.reportValidity();
  });
  form.addEventListener("htmx:beforeRequest", () => {
    refusal.replaceChildren();
    bar.value = 0;
    text.textContent = "";
    sending.hidden = false;
  });
  form.addEventListener("htmx:xhr:progress", (event) => {
    if (!event.detail.lengthComputable) return;
    // The response's progress fires the same event: never move the bar back.
    const percent = Math.max(bar.value, Math.round((100 * event.detail.loaded) / event.detail.total));
    bar.value = percent;
    const said = percent < 100 ? `${Math.floor(percent / 10) * 10} percent sent` : "sent, checking";
    if (text.textContent !== said) text.textContent = said;
  });
  form.addEventListener("htmx:beforeSwap", (event) => {
    const answer = event.detail.xhr.responseText;
    if (answer.toLowerCase().startsWith("<!doctype")) {
      // A complete page: logged out meanwhile, or the database is unavailable. Show its message only.
      const page = new DOMParser().parseFromString(answer, "text/html");
      say(page.querySelector(".problem, main p")?.textContent ?? "The server does not answer; try again.");
      event.detail.shouldSwap = false;
    } else {
      event.detail.shouldSwap = event.detail.xhr.status !== 204;
    }
    event.detail.isError = false;
  });
  form.addEventListener("htmx:afterRequest", (event) => {
    if (!event.detail.xhr.getResponseHeader("HX-Redirect")) sending.hidden = true;
  });
  form.addEventListener("htmx:sendError", () => say("The server does not answer; nothing was sent. Try again."));
});
