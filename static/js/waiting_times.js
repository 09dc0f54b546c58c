/**
 * How often to ask whether the videos are recorded, and after how long a wait is called long.
 */

/** Nobody is told that it takes long before this many seconds, however quick the machine usually is. */
const LONG_S = 45;

/** A wait is long when it has lasted this many times the usual one. */
const TIMES_USUAL = 3;

/** Without a machine nothing can come: the way out is shown this soon. */
const NO_MACHINE_S = 20;

/**
 * @param {number} waited seconds
 * @returns {number} seconds until the server is asked again
 */
export function pollSeconds(waited) {
  if (waited < 30) {
    return 1;
  }
  return waited < 300 ? 3 : 10;
}

/**
 * @param {number} waited seconds
 * @param {number | null} usually seconds; null before the first recording
 * @param {number} machines connected
 * @returns {boolean} whether to say that it takes longer than usual, and how to leave
 */
export function isLong(waited, usually, machines) {
  if (machines === 0) {
    return waited > NO_MACHINE_S;
  }
  return waited > Math.max(LONG_S, TIMES_USUAL * (usually ?? LONG_S));
}
