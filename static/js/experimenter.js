/**
 * The experimenter's pages: a link to copy, and times in the reader's own form.
 */

import { announce, byId } from "./dom.js";
import { showLocalTimes } from "./times.js";

for (const button of document.querySelectorAll("button[data-copy]")) {
  if (!(button instanceof HTMLElement)) {
    continue;
  }
  const label = button.textContent;
  button.addEventListener("click", async () => {
    const source = byId(button.dataset.copy ?? "");
    try {
      await navigator.clipboard.writeText(source.textContent?.trim() ?? "");
      button.textContent = "Copied";
      announce("The link is copied.");
    } catch {
      // Without leave to use the clipboard: mark the text, so that it can be copied by hand.
      getSelection()?.selectAllChildren(source);
      button.textContent = "Press Ctrl+C to copy";
      announce("The link is selected. Press Control C to copy it.");
    }
    setTimeout(() => {
      button.textContent = label;
    }, 2500);
  });
}

showLocalTimes(document);
