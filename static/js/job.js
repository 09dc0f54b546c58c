/**
 * A job's progress: asked for now and then; when it is over the page is loaded again.
 */

import { announce } from "./dom.js";
import { Unreachable, request } from "./request.js";

const EVERY_MS = 1000;
const WAIT_FOR_ANSWER_MS = 15_000;

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
      const answer = await request(job.dataset.job ?? "", { headers: { accept: "application/json" } }, WAIT_FOR_ANSWER_MS);
      if (!answer.ok || !answer.content.startsWith("{")) {
        continue; // refused for now, or a page that stands before the server's
      }
      const state = JSON.parse(answer.content);
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
    } catch (error) {
      if (!(error instanceof Unreachable)) {
        if (says) {
          says.textContent = "This page has failed to show how far it is. Reload it to see.";
        }
        throw error;
      }
      // The server is away for a moment: ask again.
    }
  }
}
