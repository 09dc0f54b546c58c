/**
 * The experimenter's pages: a text to copy, and times in the reader's own form and zone.
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
      announce("Copied.");
    } catch {
      // Without leave to use the clipboard: mark the text, so that it can be copied by hand.
      getSelection()?.selectAllChildren(source);
      button.textContent = "Press Ctrl+C to copy";
      announce("The text is selected. Press Control C to copy it.");
    }
    setTimeout(() => {
      button.textContent = label;
    }, 2500);
  });
}

showLocalTimes(document);

// A time that is typed in the reader's zone and sent in UTC.
for (const input of document.querySelectorAll("input[data-utc]")) {
  if (input instanceof HTMLInputElement) {
    const zone = input.closest("label")?.querySelector("[data-zone]");
    if (zone) {
      zone.textContent = "your time";
    }
    input.form?.addEventListener("formdata", (event) => {
      event.formData.set(input.name, new Date(input.value).toISOString());
    });
  }
}
