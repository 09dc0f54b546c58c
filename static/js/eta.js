/**
 * Estimates the time left from the durations of the comparisons so far (median of the last nine).
 */

import { store, stored } from "./storage.js";
import { gettext } from "./i18n.js";

/** Seconds for one comparison before there is anything to go by: a 10 s video and a moment to decide. */
const FIRST_GUESS_S = 14;

/** Comparisons that count: a person gets faster, and one pause must not matter. */
const REMEMBERED = 9;

/** Longer durations are counted as this many seconds: they contain a pause. */
const LONGEST_S = 120;

export class Eta {
  /** @type {number[]} */
  #seconds = [];

  /** @param {string} slug */
  constructor(slug) {
    this.key = `pbpo:pace:${slug}`;
    const before = stored("sessionStorage", this.key);
    this.#seconds = Array.isArray(before) ? before.filter(Number.isFinite) : [];
  }

  /** @param {number} seconds one comparison took, from pair to pair */
  took(seconds) {
    this.#seconds = [...this.#seconds, Math.min(seconds, LONGEST_S)].slice(-REMEMBERED);
    store("sessionStorage", this.key, this.#seconds);
  }

  /**
   * @param {import("./api.js").Progress} progress
   * @param {number} breakSeconds length of the break after a trial
   * @returns {string} such as "About 12 min left", "At most" before it where trials may end early
   */
  left({ trial, trials, query, queries, at_most: mayEndEarly }, breakSeconds) {
    const comparisons = (trials - trial) * queries + queries - query + 1;
    const seconds = comparisons * this.#typical() + (trials - trial) * breakSeconds;
    const minutes = Math.round(seconds / 60);
    if (minutes < 1) {
      return gettext("Less than a minute left");
    }
    return mayEndEarly ? gettext("At most about %(minutes)s min left", { minutes }) : gettext("About %(minutes)s min left", { minutes });
  }

  #typical() {
    if (this.#seconds.length < 3) {
      return FIRST_GUESS_S;
    }
    const sorted = [...this.#seconds].sort((a, b) => a - b);
    return sorted[Math.floor(sorted.length / 2)];
  }
}
