"use strict";
// A page that waits for the end of a drive or of a break asks the server, and loads the next step once there is one.
const POLL_MS = 2000;

async function look(wait) {
  const { step, poll } = wait.dataset;
  try {
    const response = await fetch(poll, { cache: "no-store" });
    if (response.ok && (await response.json()).step !== step) location.reload();
  } catch {
    wait.textContent = "The server does not answer; this page goes on trying.";
  }
}

function showTimeLeft(wait) {
  const left = Math.max(0, Math.ceil(Number(wait.dataset.until) - Date.now() / 1000));
  const minutes = Math.floor(left / 60);
  if (left > 0) wait.textContent = minutes ? `${minutes} min ${left % 60} s left` : `${left} s left`;
}

for (const link of document.querySelectorAll("a.whole")) link.textContent = link.href; // to copy, with the host

const wait = document.getElementById("wait");
if (wait) {
  setInterval(() => look(wait), POLL_MS);
  if (wait.dataset.until) {
    showTimeLeft(wait);
    setInterval(() => showTimeLeft(wait), 1000);
  }
}
