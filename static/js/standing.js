/**
 * How the two videos stand on the page, and whether that changes: the window gets another size, the device is turned.
 */

/** A size that lasts this long is one that somebody chose, and not one on the way to it. */
const QUIET_MS = 250;

/**
 * @param {HTMLElement} left
 * @param {HTMLElement} right
 * @returns {"side_by_side" | "stacked"}
 */
export function standing(left, right) {
  return left.getBoundingClientRect().bottom <= right.getBoundingClientRect().top ? "stacked" : "side_by_side";
}

/**
 * @param {HTMLElement} left
 * @param {HTMLElement} right
 * @param {(event: "layout" | "resized" | "turned", value: string) => void} tell
 */
export function watchStanding(left, right, tell) {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let quiet;
  let stood = standing(left, right);
  window.addEventListener("resize", () => {
    clearTimeout(quiet);
    quiet = setTimeout(() => {
      tell("resized", `${window.innerWidth}x${window.innerHeight}`);
      const stands = standing(left, right);
      if (stands !== stood) {
        stood = stands;
        tell("layout", stands);
      }
    }, QUIET_MS);
  });
  const turning = /** @type {EventTarget | undefined} */ (window.screen?.orientation);
  if (turning?.addEventListener) {
    turning.addEventListener("change", () => tell("turned", window.screen.orientation.type));
  } else {
    // Safari before 16.4.
    window.addEventListener("orientationchange", () => tell("turned", String(window.orientation)));
  }
}
