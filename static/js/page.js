/**
 * What every page does: read its heading out on arrival, or what is wrong in its form, and send each form once.
 */

import "./second_click.js";
import { focusHeading } from "./dom.js";
import { forgetTyped } from "./typed_draft.js";

const summary = document.getElementById("fault-summary");
if (summary) {
  summary.focus();
} else if (!document.querySelector('[autofocus], [role="alert"]:not([hidden])')) {
  // A page that says where to begin, or has an error to read out, keeps the focus where the browser puts it.
  focusHeading();
}

const stage = /** @type {HTMLElement | null} */ (document.querySelector("[data-stage]"))?.dataset.stage;
if (stage && stage !== "questionnaire") {
  forgetTyped();
}

document.addEventListener("submit", (event) => {
  const form = /** @type {HTMLFormElement} */ (event.target);
  if (form.method !== "post") {
    return; // asks, and changes nothing: a download leaves the page as it is, to ask for more
  }
  if (form.dataset.sent) {
    event.preventDefault(); // the second half of a double click
    return;
  }
  form.dataset.sent = "yes";
});

// A page brought back by the Back button may send its forms again; the server decides what that means.
window.addEventListener("pageshow", () => {
  for (const form of document.forms) {
    delete form.dataset.sent;
  }
});
