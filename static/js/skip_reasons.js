/**
 * Why a pair is skipped: a few small buttons below the pair, which plays on. The response counts from the press
 * on skip; what is chosen here only says what was meant by it. The reasons come in the order of the session.
 *
 * @typedef {{name: string, label: string}} Reason
 */

import { within } from "./dom.js";
import { inStudysLanguage } from "./i18n.js";

export class SkipReasons {
  /** @type {(name: string | null) => void} */
  #choose = () => {};

  /** @param {HTMLElement} panel */
  constructor(panel) {
    this.panel = panel;
    this.list = within(panel, "[data-reasons]");
    within(panel, "[data-back]").addEventListener("click", () => this.#close(null));
    panel.addEventListener("keydown", (event) => this.#key(event));
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.isOpen) {
        this.#close(null);
        event.preventDefault();
      }
    });
  }

  get isOpen() {
    return !this.panel.hidden;
  }

  /**
   * @param {Reason[]} reasons
   * @returns {Promise<string | null>} the name of the reason, or null for going back
   */
  ask(reasons) {
    this.list.textContent = "";
    this.list.append(...reasons.map((reason) => this.#button(reason)));
    this.panel.hidden = false;
    this.#makeRoom();
    // Not one of the reasons: the key that was pressed last, or that is held, must not choose one.
    this.panel.focus();
    return new Promise((resolve) => {
      this.#choose = resolve;
    });
  }

  /** Another pair is on the page: nobody waits for a reason any more. */
  dismiss() {
    if (this.isOpen) {
      this.#close(null);
    }
  }

  /** @returns {HTMLButtonElement[]} */
  get buttons() {
    return [...this.panel.querySelectorAll("button")];
  }

  /** @param {Reason} reason */
  #button({ name, label }) {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "button button-line button-small";
    button.dataset.testid = `reason-${name}`;
    button.textContent = label;
    inStudysLanguage(button);
    button.addEventListener("click", () => this.#close(name));
    return button;
  }

  /** @param {string | null} name */
  #close(name) {
    this.panel.hidden = true;
    this.#makeRoom();
    this.#choose(name);
  }

  /** Both videos become smaller by as much as the panel needs of the page's height. */
  #makeRoom() {
    const page = /** @type {HTMLElement | null} */ (this.panel.closest("main"));
    page?.style.setProperty("--panel", this.isOpen ? `${this.panel.offsetHeight}px` : "0px");
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const steps = { ArrowDown: 1, ArrowRight: 1, ArrowUp: -1, ArrowLeft: -1 };
    const step = steps[/** @type {keyof typeof steps} */ (event.key)];
    if (step && event.repeat) {
      // The key that opened the panel is still held.
    } else if (step) {
      const { buttons } = this;
      const at = buttons.indexOf(/** @type {HTMLButtonElement} */ (document.activeElement));
      const next = at < 0 && step < 0 ? buttons.length - 1 : at + step;
      buttons[(next + buttons.length) % buttons.length].focus();
    } else if (event.key === " " && document.activeElement === this.panel) {
      // Neither a reason nor a key that scrolls the page away from under the panel.
    } else {
      return;
    }
    event.preventDefault();
  }
}
