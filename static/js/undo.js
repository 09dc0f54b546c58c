/**
 * A quiet button that takes the last answer back, for as long as the server says that it may be.
 */

import { focusHeading } from "./dom.js";

export class Undo {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;

  /**
   * @param {HTMLElement} button
   * @param {(queryId: string) => void} onPress
   */
  constructor(button, onPress) {
    this.button = button;
    this.queryId = "";
    button.addEventListener("click", () => {
      if (this.queryId) {
        onPress(this.queryId);
      }
    });
  }

  /** @param {{query_id: string, seconds_left: number} | undefined} offered */
  offer(offered) {
    clearTimeout(this.#timer);
    if (!offered) {
      this.withdraw();
      return;
    }
    this.queryId = offered.query_id;
    this.button.hidden = false;
    this.#timer = setTimeout(() => this.withdraw(), offered.seconds_left * 1000);
  }

  /** No more: the focus must not vanish with the button. */
  withdraw() {
    clearTimeout(this.#timer);
    this.queryId = "";
    if (document.activeElement === this.button) {
      focusHeading();
    }
    this.button.hidden = true;
  }
}
