/**
 * What a page says when a script of ours has failed: that, and never that the line is broken.
 */

import { announce, byId } from "./dom.js";

/** The page has begun to work: fallback.js, which watches over its beginning, has nothing to do. */
export function isReady() {
  document.documentElement.dataset.ready = "yes";
}

/** @returns {boolean} */
export function wasReady() {
  return "ready" in document.documentElement.dataset;
}

/** @param {unknown} error */
export function showFailure(error) {
  console.error(error);
  const says = byId("failure");
  says.hidden = false;
  announce(says.textContent ?? "");
}
