/**
 * Keeps what is typed into a questionnaire until it is sent: a reload, Back or another page of the study takes nothing
 * away. It is kept in this tab alone, under a name that the server gives to this session and questionnaire.
 */

import { remove, store, stored } from "./storage.js";

const PREFIX = "pbpo:typed:";

/** @typedef {HTMLInputElement | HTMLTextAreaElement} Field */

/**
 * @param {HTMLFormElement} form
 * @returns {Field[]} what a person fills in
 */
function fields(form) {
  return /** @type {Field[]} */ ([...form.querySelectorAll('textarea, input:not([type="hidden"])')]);
}

/** @param {Field} field */
function isChoice(field) {
  return field.type === "radio" || field.type === "checkbox";
}

/** @param {HTMLFormElement} form */
export function keepTyped(form) {
  const key = PREFIX + form.dataset.keptAs;
  const keep = () => {
    const typed = fields(form).filter((field) => (isChoice(field) ? /** @type {HTMLInputElement} */ (field).checked : field.value !== ""));
    store("sessionStorage", key, typed.map(({ name, value }) => [name, value]));
  };
  const kept = stored("sessionStorage", key);
  for (const [name, value] of Array.isArray(kept) ? kept : []) {
    for (const field of fields(form).filter((one) => one.name === name)) {
      if (!isChoice(field)) {
        field.value = value;
      } else if (field.value === value) {
        /** @type {HTMLInputElement} */ (field).checked = true;
      }
    }
  }
  form.addEventListener("input", keep);
  form.addEventListener("change", keep);
}

/** The session is past its questionnaire, or another person's: nothing of it stays. */
export function forgetTyped() {
  try {
    const keys = Object.keys(sessionStorage).filter((key) => key.startsWith(PREFIX));
    keys.forEach((key) => remove("sessionStorage", key));
  } catch {
    // A browser that keeps nothing has nothing to forget.
  }
}
