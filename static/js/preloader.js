/**
 * Videos fetched ahead of time, as blobs that a player can show without asking the network.
 *
 * @typedef {{loading: Promise<string | null>, blobUrl: string | null, stop: AbortController | null}} Entry
 */

/**
 * Cached responses are revalidated. Recordings in a store of another site are cached by their signed
 * link, which several addresses of ours lead to: where a player asked for it first, the response has
 * no CORS header, and a cached copy of it would be refused to this script.
 */
const CACHE = "no-cache";

/** Two requests at a time leave the line room for everything else. */
const AT_ONCE = 2;

/** Blobs kept beyond those still asked for: a pair that comes again, or comes one query later. */
const KEPT = 12;

/** The time a whole video (about 0.4 MB) takes on a line too slow to take part on. */
const TIMEOUT_MS = 60_000;

export class Preloader {
  /** @type {Map<string, Entry>} */
  #entries = new Map();
  /** @type {string[]} */
  #queue = [];
  #running = 0;
  /** @type {Set<string>} */
  #missing = new Set();

  /**
   * Fetch these, in this order, after what is already under way.
   * @param {string[]} urls likeliest first
   */
  want(urls) {
    this.#queue = urls.filter((url) => !this.#entries.has(url));
    // Asked for again: young again.
    for (const url of urls) {
      const entry = this.#entries.get(url);
      if (entry) {
        this.#entries.delete(url);
        this.#entries.set(url, entry);
      }
    }
    this.#fill();
  }

  /**
   * A source for this video: a blob if it is here or on its way, else the address itself.
   * Never rejects; a fetch that fails leaves the address.
   * @param {string} url
   * @returns {string | Promise<string>}
   */
  source(url) {
    const entry = this.#entries.get(url);
    if (!entry) {
      return url;
    }
    return entry.blobUrl ?? entry.loading.then((blobUrl) => blobUrl ?? url);
  }

  /**
   * Stop fetching, and let go of what is not among the newest, except for these.
   * @param {string[]} inUse
   */
  settle(inUse) {
    this.#queue = [];
    for (const [url, entry] of this.#entries) {
      if (!entry.blobUrl && !inUse.includes(url)) {
        entry.stop?.abort();
        this.#entries.delete(url);
      }
    }
    for (const [url, entry] of this.#entries) {
      if (this.#entries.size <= KEPT) {
        break;
      }
      if (entry.blobUrl && !inUse.includes(url)) {
        URL.revokeObjectURL(entry.blobUrl);
        this.#entries.delete(url);
      }
    }
  }

  /**
   * Whether the server said, when last asked, that it does not have this video.
   * @param {string} url
   */
  isMissing(url) {
    return this.#missing.has(url);
  }

  /**
   * Fetch a video that would not play afresh, past every cache.
   * @param {string} url
   * @returns {Promise<string | null>} null if that failed too
   */
  again(url) {
    const old = this.#entries.get(url);
    if (old) {
      old.stop?.abort();
      if (old.blobUrl) {
        URL.revokeObjectURL(old.blobUrl);
      }
    }
    return this.#fetch(url, "reload");
  }

  #fill() {
    while (this.#running < AT_ONCE && this.#queue.length > 0) {
      const url = /** @type {string} */ (this.#queue.shift());
      this.#running += 1;
      this.#fetch(url, CACHE).then(() => {
        this.#running -= 1;
        this.#fill();
      });
    }
  }

  /**
   * @param {string} url
   * @param {RequestCache} cache
   * @returns {Promise<string | null>}
   */
  #fetch(url, cache) {
    const stop = typeof AbortController === "function" ? new AbortController() : null;
    /** @type {Entry} */
    const entry = {
      blobUrl: null,
      stop,
      loading: fetchedBlob(url, cache, stop).then((answer) => {
        if (answer === "missing") {
          this.#missing.add(url);
        } else {
          this.#missing.delete(url);
        }
        if (this.#entries.get(url) !== entry) {
          return null; // let go of while it was on its way
        }
        entry.blobUrl = answer && answer !== "missing" ? addressOf(answer) : null;
        if (!entry.blobUrl) {
          this.#entries.delete(url);
        }
        return entry.blobUrl;
      }),
    };
    this.#entries.set(url, entry);
    return entry.loading;
  }
}

/**
 * @param {string} url
 * @param {RequestCache} cache
 * @param {AbortController | null} stop
 * @returns {Promise<Blob | "missing" | null>}
 */
async function fetchedBlob(url, cache, stop) {
  const timer = setTimeout(() => stop?.abort(), TIMEOUT_MS);
  try {
    const response = await fetch(url, { cache, credentials: "same-origin", ...(stop ? { signal: stop.signal } : {}) });
    if (response.status === 404) {
      return "missing";
    }
    return response.ok ? await response.blob() : null;
  } catch {
    return null;
  } finally {
    clearTimeout(timer);
  }
}

/**
 * @param {Blob} blob
 * @returns {string | null} null where the browser gives a blob no address: the video is played by its own then
 */
function addressOf(blob) {
  try {
    return URL.createObjectURL(blob);
  } catch {
    return null;
  }
}
