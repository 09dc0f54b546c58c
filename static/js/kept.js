/**
 * What the browser keeps for this study from page to page. A browser that keeps nothing is no fault: its storage may
 * be absent, throw or be full, and then everything lives as long as the page does.
 */

/**
 * @param {"localStorage" | "sessionStorage"} where
 * @param {string} key
 * @returns {unknown} what was kept, or null
 */
export function kept(where, key) {
  try {
    return JSON.parse(window[where].getItem(key) ?? "null");
  } catch {
    return null;
  }
}

/**
 * @param {"localStorage" | "sessionStorage"} where
 * @param {string} key
 * @param {unknown} value
 */
export function keep(where, key, value) {
  try {
    window[where].setItem(key, JSON.stringify(value));
  } catch {
    // As said above.
  }
}

/**
 * @param {"localStorage" | "sessionStorage"} where
 * @param {string} key
 */
export function forget(where, key) {
  try {
    window[where].removeItem(key);
  } catch {
    // As said above.
  }
}
