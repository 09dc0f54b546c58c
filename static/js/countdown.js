/**
 * Time left, counted by the clock that never jumps: only the seconds left come from the server,
 * so that a computer whose date is wrong counts right.
 */

import { now } from "./dom.js";
import { gettext } from "./i18n.js";

export class Countdown {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;
  #endsAt = 0;

  /** @param {{onTick: (secondsLeft: number) => void, onOver: () => void}} listener */
  constructor(listener) {
    this.listener = listener;
  }

  /** @param {number} secondsLeft */
  set(secondsLeft) {
    this.#endsAt = now() + secondsLeft * 1000;
    this.#tick();
  }

  #tick() {
    clearTimeout(this.#timer);
    const left = this.#endsAt - now();
    if (left <= 0) {
      this.listener.onTick(0);
      this.listener.onOver();
      return;
    }
    const whole = Math.ceil(left / 1000);
    this.listener.onTick(whole);
    // Wake just after the second turns, so that no second is shown twice or left out.
    this.#timer = setTimeout(() => this.#tick(), left - (whole - 1) * 1000 + 5);
  }
}

/**
 * @param {number} seconds whole
 * @returns {string} minutes and seconds as the language writes them, "1:05"
 */
export function clockFace(seconds) {
  return gettext("%(minutes)s:%(seconds)s", {
    minutes: Math.floor(seconds / 60),
    seconds: String(seconds % 60).padStart(2, "0"),
  });
}
