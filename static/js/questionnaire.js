/**
 * The questionnaire page: keeps what is typed, and says how much more fits into a text before it is full.
 */

import { announce, byId } from "./dom.js";
import { gettext } from "./i18n.js";
import { keepTyped } from "./typed_draft.js";

/** From so many characters left on, the page says how many: nobody writes that much by accident. */
const SAY_FROM = 200;

const form = document.querySelector('[data-testid="questionnaire"]');

/** @param {HTMLElement} line the one that counts a field */
function count(line) {
  const field = /** @type {HTMLTextAreaElement} */ (byId(line.dataset.countOf ?? ""));
  const say = () => {
    // As the browser and the server count: a line break once, an emoji twice.
    const left = field.maxLength - field.value.length;
    const text = left > 0 ? gettext("Characters left: %(left)s", { left }) : gettext("The field is full: what comes after this is not taken.");
    line.hidden = left > SAY_FROM;
    if (left <= 0 && line.textContent !== text) {
      announce(text);
    }
    line.textContent = text;
  };
  field.addEventListener("input", say);
  say();
}

if (form instanceof HTMLFormElement) {
  keepTyped(form);
  for (const line of /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll("[data-count-of]"))) {
    count(line);
  }
}
