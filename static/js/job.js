/**
 * A job's progress: asked for now and then; when it is over the page is loaded again.
 */

import { announce } from "./dom.js";

const EVERY_MS = 1000;

for (const job of document.querySelectorAll("[data-job]")) {
  if (job instanceof HTMLElement) {
    void watch(job);
  }
}

/** @param {HTMLElement} job */
async function watch(job) {
  const bar = job.querySelector("progress");
  const says = job.querySelector("[data-job-says]");
  for (;;) {
    await new Promise((resolve) => setTimeout(resolve, EVERY_MS));
    try {
      const answer = await fetch(job.dataset.job ?? "", { headers: { accept: "application/json" } });
      if (!answer.ok) {
        continue;
      }
      const state = await answer.json();
      if (bar instanceof HTMLProgressElement && says instanceof HTMLElement) {
        bar.max = state.total;
        bar.value = state.done;
        says.textContent = state.state === "waiting" ? "It has not begun yet." : `${state.done} of ${state.total}`;
      }
      if (state.is_over) {
        announce("It is done.");
        location.reload();
        return;
      }
    } catch {
      // The server is away for a moment: ask again.
    }
  }
}
