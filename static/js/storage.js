/**
 * Reads and writes JSON values in the browser's storage. Storage that is absent, throws or is full is ignored: values
 * then last only as long as the page.
 */

/**
 * @param {"localStorage" | "sessionStorage"} where
 * @param {string} key
 * @returns {unknown} the stored value, or null
 */
export function stored(where, key) {
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
export function store(where, key, value) {
  try {
    window[where].setItem(key, JSON.stringify(value));
  } catch {
    // Ignored, as stated above.
  }
}

/**
 * @param {"localStorage" | "sessionStorage"} where
 * @param {string} key
 */
export function remove(where, key) {
  try {
    window[where].removeItem(key);
  } catch {
    // Ignored, as stated above.
  }
}
