/**
 * The session's half of `/api/v1`: who is asking travels in the cookie, which study in a header.
 *
 * @typedef {{url: string, duration_s: number}} Recording
 * @typedef {{id: string, left: Recording, right: Recording, skip: null | Skip, prefetch: string[], watch_once?: boolean, undo?: {query_id: string, seconds_left: number}}} Query
 * @typedef {{since: string | null, usually_s: number | null, machines: number, left: Recording | null, right: Recording | null, undo?: {query_id: string, seconds_left: number}}} Waiting
 * @typedef {{label: string, reasons?: import("./skip_reasons.js").Reason[]}} Skip
 * @typedef {{trial: number, trials: number, query: number, queries: number, at_most?: boolean}} Progress
 * @typedef {{
 *   stage: string, progress: Progress, study: {break_s: number, stages: string[]}, query?: Query | null,
 *   waiting?: Waiting,
 *   break?: {ends_at: string, seconds_left: number},
 *   device_check?: {clip: Recording, test_clip: boolean, min_width_px: number | null, min_mbit_s: number | null},
 *   familiarisation?: {videos: Recording[], required: number, watched: number[], speeds: number[]},
 * }} State
 * @typedef {"left" | "right" | "skip"} Response
 * @typedef {{event: string, side: string | null, time_ms: number, value: number | string | null}} Evidence
 * @typedef {{query_id: string, response: Response, rt_ms: number, replays: number, skip_reason?: string, events: Evidence[], events_left_out: number}} Answer
 * @typedef {{query_id: string, reason: string, events: Evidence[], events_left_out: number}} Fault
 */

import { Unreachable, request } from "./request.js";

/** A request that takes longer than this is taken for a broken line, and tried again. */
const TIMEOUT_MS = 15_000;

/** The server answered that it will not do this (RFC 9457). */
export class Refused extends Error {
  /**
   * @param {number} status
   * @param {{type?: string, title?: string, detail?: string, stage?: string}} problem
   */
  constructor(status, problem) {
    super(problem.detail || problem.title || `The server answered ${status}.`);
    this.status = status;
    this.stage = problem.stage;
    /** What kind of refusal it is: the last part of the problem's `type`. */
    this.kind = problem.type?.split(":").pop() ?? "";
  }

  /** Whether the very same request may succeed later. */
  get isPassing() {
    return this.status >= 500 || this.status === 408 || this.status === 425 || this.status === 429;
  }
}

/**
 * @param {unknown} error
 * @returns {boolean} whether the very same request may succeed later; never of a mistake of ours
 */
export function mayPass(error) {
  return error instanceof Unreachable || (error instanceof Refused && error.isPassing);
}

export class SessionApi {
  /** @param {string} slug */
  constructor(slug) {
    this.slug = slug;
  }

  /** @returns {Promise<State>} where the session is now */
  session() {
    return this.#call("GET", "/session");
  }

  /**
   * @param {Answer} answer
   * @returns {Promise<State>}
   */
  respond(answer) {
    return this.#call("POST", "/session/responses", answer);
  }

  /**
   * Take the response to this query back.
   * @param {string} queryId
   * @returns {Promise<State>}
   */
  undo(queryId) {
    return this.#call("POST", "/session/undo", { query_id: queryId });
  }

  /**
   * A video of this query did not play: another query takes its place.
   * @param {Fault} fault
   * @returns {Promise<State>}
   */
  reportFault(fault) {
    return this.#call("POST", "/session/faults", fault);
  }

  /**
   * Leave the device check with what was measured.
   * @param {{width_px: number, played: boolean, mbit_s: number | null}} device
   * @returns {Promise<State>}
   */
  passDeviceCheck(device) {
    return this.#call("POST", "/session/continue", { device });
  }

  /**
   * The video at this place of the familiarisation was watched to its end.
   * @param {number} index
   * @returns {Promise<State>}
   */
  watched(index) {
    return this.#call("POST", "/session/watched", { index });
  }

  /**
   * @param {string} method
   * @param {string} path
   * @param {object} [body]
   * @returns {Promise<State>}
   */
  async #call(method, path, body) {
    /** @type {Record<string, string>} */
    const headers = { "PBPO-Study": this.slug, Accept: "application/json" };
    if (body) {
      headers["Content-Type"] = "application/json";
    }
    /** @type {RequestInit} */
    const options = { method, headers, credentials: "same-origin", cache: "no-store" };
    if (body) {
      options.body = JSON.stringify(body);
    }
    const answer = await request(`${document.documentElement.dataset.root ?? ""}/api/v1${path}`, options, TIMEOUT_MS);
    const value = parsed(answer.content);
    if (answer.status === 410) {
      // The study was deleted: its page says so, and has the way back.
      location.reload();
    }
    if (!answer.ok) {
      throw new Refused(answer.status, value ?? {});
    }
    if (!value) {
      // A proxy or a hotel's sign-in page answered in the server's place.
      throw new Unreachable("the answer was not JSON");
    }
    return value;
  }
}

/** @param {string} content */
function parsed(content) {
  try {
    return JSON.parse(content);
  } catch {
    return null;
  }
}
