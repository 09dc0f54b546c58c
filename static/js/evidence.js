/**
 * What happened while one pair was on the page: the evidence that goes with an answer.
 * Times are milliseconds since the pair came onto the page; `rt_ms` is counted from both videos playing.
 */

import { attempt, now } from "./dom.js";

/** A record longer than this says nothing more; it only gets heavier. The server keeps 60. */
const MOST_EVENTS = 48;

/** What is told however long the record is: it comes once, at the end. */
const ALWAYS = new Set(["pressed", "watched", "width", "dropped_frames", "worst_drift"]);

export class EvidenceLog {
  replays = 0;
  /** @type {import("./api.js").Evidence[]} */
  #events = [];
  #leftOut = 0;
  #shownAt = 0;
  #playingAt = NaN;

  constructor() {
    document.addEventListener("visibilitychange", () => this.add(document.visibilityState));
    window.addEventListener("blur", () => this.add("blur"));
    window.addEventListener("focus", () => this.add("focus"));
  }

  /** A new pair is on the page. */
  begin() {
    this.replays = 0;
    this.#events = [];
    this.#leftOut = 0;
    this.#shownAt = now();
    this.#playingAt = NaN;
    this.add("shown");
    this.add(document.visibilityState);
    if ("enlarged" in document.documentElement.dataset) {
      this.add("fullscreen", null, 1);
    }
  }

  /** @param {number} at when the later of the two began to play */
  bothPlaying(at) {
    this.#playingAt = at;
  }

  /**
   * @param {string} event
   * @param {string | null} [side]
   * @param {number | string | null} [value]
   */
  add(event, side = null, value = null) {
    if (this.#events.length >= MOST_EVENTS && !ALWAYS.has(event)) {
      this.#leftOut += 1;
      return;
    }
    this.#events.push({ event, side, time_ms: Math.round(now() - this.#shownAt), value });
  }

  /**
   * The record as it stands when a response is pressed.
   * @param {string} queryId
   * @param {import("./api.js").Response} response
   * @param {number} pressedAt milliseconds on the page's clock
   * @param {import("./synced_pair.js").SyncedPair} pair
   * @returns {import("./api.js").Answer}
   */
  answer(queryId, response, pressedAt, pair) {
    return {
      query_id: queryId,
      response,
      rt_ms: Math.max(0, Math.round(pressedAt - this.#playingAt)),
      replays: this.replays,
      events: this.#close(pair),
      events_left_out: this.#leftOut,
    };
  }

  /**
   * The record as it stands when a video is said not to play.
   * @param {string} queryId
   * @param {string} how it was noticed
   * @param {import("./synced_pair.js").SyncedPair} pair
   * @returns {import("./api.js").Fault}
   */
  fault(queryId, how, pair) {
    const seen = pair.players.map(({ side, state }) => `${side}: ${state}`);
    return { query_id: queryId, reason: [how, ...seen].join("; "), events: this.#close(pair), events_left_out: this.#leftOut };
  }

  /**
   * @param {import("./synced_pair.js").SyncedPair} pair
   * @returns {import("./api.js").Evidence[]} all of it, with what can only be told in the end
   */
  #close(pair) {
    for (const { side, video } of pair.players) {
      attempt(() => this.add("watched", side, Math.round(watchedFraction(video) * 1000) / 1000));
      this.add("width", side, Math.round(video.clientWidth));
      attempt(() => this.add("dropped_frames", side, video.getVideoPlaybackQuality?.().droppedVideoFrames ?? null));
    }
    this.add("worst_drift", null, Math.round(pair.worstDrift));
    return this.#events;
  }
}

/**
 * @param {HTMLVideoElement} video
 * @returns {number} the part of the video that was played at least once, 0 to 1
 */
function watchedFraction({ played, duration }) {
  let seconds = 0;
  for (let index = 0; index < played.length; index += 1) {
    seconds += played.end(index) - played.start(index);
  }
  return duration > 0 ? Math.min(1, seconds / duration) : 0;
}
