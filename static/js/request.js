/**
 * One request with a limit of time, by what the browser has: without AbortController it is let go of, not stopped.
 */

/** The server could not be reached, or did not answer in time. Nothing else is: a mistake of ours is thrown as it is. */
export class Unreachable extends Error {}

/**
 * @param {string} address
 * @param {RequestInit} options
 * @param {number} limitMs
 * @returns {Promise<{ok: boolean, status: number, content: string}>}
 */
export async function request(address, options, limitMs) {
  const stop = typeof AbortController === "function" ? new AbortController() : null;
  const asked = stop ? { ...options, signal: stop.signal } : options;
  if (typeof Request === "function") {
    // `fetch` says of a request that cannot be made just what it says of a broken line; this does not.
    new Request(address, asked);
  }
  const answered = fetch(address, asked);
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  const late = new Promise((_resolve, reject) => {
    timer = setTimeout(() => {
      stop?.abort();
      reject(new Error("no answer in time"));
    }, limitMs);
  });
  try {
    const response = await Promise.race([answered, late]);
    const content = await Promise.race([response.text(), late]);
    return { ok: response.ok, status: response.status, content };
  } catch (error) {
    throw new Unreachable(String(error));
  } finally {
    clearTimeout(timer);
  }
}
