/**
 * The buttons under the pair: when they may be pressed, and which one was.
 * The skip button is on the page only while the condition offers a skip.
 */

import { wasReady } from "./failure.js";
import { inStudysLanguage } from "./i18n.js";

export class AnswerButtons {
  /** @type {boolean} */
  #open = false;

  /**
   * @param {HTMLElement} pair
   * @param {(response: import("./api.js").Response, event: Event) => void} onPress
   */
  constructor(pair, onPress) {
    this.pair = pair;
    this.onPress = onPress;
    for (const button of this.buttons) {
      this.#listen(button);
    }
  }

  /** @returns {HTMLButtonElement[]} */
  get buttons() {
    return [...this.pair.querySelectorAll("button")].filter((button) => button.dataset.side);
  }

  get isOpen() {
    return this.#open;
  }

  /** @param {boolean} open */
  set isOpen(open) {
    this.#open = open;
    for (const button of this.buttons) {
      button.disabled = false; // as it is only where no script works
      button.setAttribute("aria-disabled", String(!open));
      if (open) {
        delete button.dataset.chosen;
      }
    }
  }

  /**
   * A new pair: nothing is pressed, and nothing can be yet.
   * @param {{label: string} | null} skip
   */
  reset(skip) {
    this.pair.toggleAttribute("data-skips", skip !== null);
    const present = this.buttons.find((button) => button.dataset.side === "skip");
    if (!skip) {
      present?.remove();
    } else {
      const button = present ?? this.#addSkip();
      const label = button.querySelector("span");
      if (label) {
        label.textContent = skip.label;
      }
    }
    this.isOpen = false;
    for (const button of this.buttons) {
      delete button.dataset.chosen;
    }
  }

  /**
   * Show at once what was pressed.
   * @param {import("./api.js").Response} response
   */
  confirm(response) {
    this.isOpen = false;
    for (const button of this.buttons) {
      button.toggleAttribute("data-chosen", button.dataset.side === response);
    }
  }

  /** @returns {HTMLButtonElement} */
  #addSkip() {
    const [left, right] = this.buttons;
    const button = /** @type {HTMLButtonElement} */ (left.cloneNode());
    button.className = "button button-red";
    button.dataset.side = "skip";
    button.value = "skip";
    button.dataset.testid = "skip";
    const key = document.createElement("kbd");
    key.className = "key key-y";
    key.setAttribute("aria-hidden", "true");
    key.textContent = "↓";
    const label = document.createElement("span");
    inStudysLanguage(label);
    button.append(label, key);
    this.#listen(button);
    this.pair.insertBefore(button, right);
    return button;
  }

  /** @param {HTMLButtonElement} button */
  #listen(button) {
    button.addEventListener("click", (event) => {
      if (!wasReady()) {
        return; // the browser sends the form
      }
      event.preventDefault();
      this.onPress(/** @type {import("./api.js").Response} */ (button.dataset.side), event);
    });
  }
}
