/**
 * The answer on its way to the server. It is kept in the browser until the server has it, and sent again
 * for as long as that takes, so that nobody is asked the same thing twice because a line broke.
 */

import { mayPass } from "./api.js";
import { pause } from "./dom.js";
import { remove, store, stored } from "./storage.js";

/** Seconds between attempts; the last one repeats. */
const BACKOFF_S = [1, 2, 4, 8, 15];

export class Outbox {
  /** @type {() => void} */
  #wake = () => {};

  /**
   * @param {import("./api.js").SessionApi} api
   * @param {{onLate: () => void, onSaved: () => void}} listener told when an attempt failed, and when a late answer was saved
   */
  constructor(api, listener) {
    this.api = api;
    this.listener = listener;
    this.key = `pbpo:answer:${api.slug}`;
    window.addEventListener("online", () => this.tryNow());
  }

  /**
   * Send an answer until the server has it or refuses it for good.
   * @param {import("./api.js").Answer} answer
   * @returns {Promise<import("./api.js").State>}
   */
  async send(answer) {
    store("localStorage", this.key, answer);
    for (let attempt = 0; ; attempt += 1) {
      try {
        const state = await this.api.respond(answer);
        remove("localStorage", this.key);
        if (attempt > 0) {
          this.listener.onSaved();
        }
        return state;
      } catch (error) {
        if (!mayPass(error)) {
          remove("localStorage", this.key);
          throw error;
        }
        this.listener.onLate();
        const woken = new Promise((resolve) => {
          this.#wake = () => resolve(undefined);
        });
        await Promise.race([pause(BACKOFF_S[Math.min(attempt, BACKOFF_S.length - 1)]), woken]);
      }
    }
  }

  /** Do not wait for the next attempt. */
  tryNow() {
    this.#wake();
  }

  /**
   * The answer to this query that an earlier visit to the page could not save.
   * @param {string} queryId
   * @returns {import("./api.js").Answer | null}
   */
  unsaved(queryId) {
    const answer = /** @type {import("./api.js").Answer | null} */ (stored("localStorage", this.key));
    return answer?.query_id === queryId ? answer : null;
  }
}
