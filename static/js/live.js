/**
 * A study's page, live: the server says that something has changed, and the page fetches the part that changes.
 * Where the stream cannot be had, or the page names none, it asks every few seconds; where nothing can, it offers to reload.
 */

import { announce, byId, within } from "./dom.js";
import { morph } from "./dom_morph.js";
import { Unreachable, request } from "./request.js";
import { showLocalTimes } from "./times.js";

/** No more often than this, however much goes on, in milliseconds. */
const BETWEEN_FETCHES = 1000;
const BETWEEN_ASKING = 10_000;
/** Nobody wants to hear every answer. */
const BETWEEN_ANNOUNCEMENTS = 15_000;
const WAIT_FOR_ANSWER = 15_000;

const line = document.querySelector("[data-live]");
if (line instanceof HTMLElement) {
  watch(line);
}

/** @param {HTMLElement} line */
function watch(line) {
  const says = within(line, "[data-live-says]");
  const reload = within(line, "[data-live-reload]");
  let fetching = false;
  let again = false;
  let announcedAt = Date.now();
  let announced = figures();
  /** @type {ReturnType<typeof setInterval> | undefined} */
  let asking;

  /** @param {string} text @param {boolean} [lost] */
  function say(text, lost = false) {
    if (says.textContent !== text) {
      says.textContent = text;
    }
    line.toggleAttribute("data-lost", lost);
    reload.hidden = !lost;
  }

  async function refresh() {
    if (fetching) {
      again = true;
      return;
    }
    fetching = true;
    try {
      const answer = await request(line.dataset.live ?? "", { redirect: "error" }, WAIT_FOR_ANSWER);
      if (!answer.ok) {
        throw new Unreachable(`expected the page's part, got ${answer.status}`);
      }
      show(answer.content);
      say(asking ? "What has changed is fetched every 10 seconds." : "Live: this page follows what happens.");
    } catch (error) {
      if (error instanceof Unreachable) {
        say("The server cannot be reached, or you are signed out: this is how it was before.", true);
      } else {
        console.error(error);
        say("This page has failed to show what has changed, by a fault of its own: this is how it was before.", true);
      }
    }
    setTimeout(() => {
      fetching = false;
      if (again) {
        again = false;
        refresh();
      }
    }, BETWEEN_FETCHES);
  }

  /** @param {string} html */
  function show(html) {
    const fresh = new DOMParser().parseFromString(html, "text/html").getElementById("watching");
    if (!fresh) {
      throw new Error("expected the part that changes");
    }
    showLocalTimes(fresh);
    morph(byId("watching"), fresh);
    if (Date.now() - announcedAt >= BETWEEN_ANNOUNCEMENTS) {
      announcedAt = Date.now();
      if (figures() !== announced) {
        announced = figures();
        announce(announced);
      }
    }
  }

  /** The first two figures of the page, in words. */
  function figures() {
    const numbers = [...document.querySelectorAll('[data-testid="counts"] > div')].slice(0, 2);
    return numbers.map((pair) => `${pair.querySelector("dt")?.textContent}: ${pair.querySelector("dd")?.textContent}`).join(", ");
  }

  /** @type {EventSource | undefined} */
  let stream;

  function open() {
    if (typeof EventSource !== "function" || !line.dataset.events) {
      asking ??= setInterval(refresh, BETWEEN_ASKING);
      say("What has changed is fetched every 10 seconds.");
      return;
    }
    const stamp = encodeURIComponent(byId("watching").dataset.stamp ?? "");
    stream = new EventSource(`${line.dataset.events}&known=${stamp}`);
    stream.addEventListener("open", () => {
      clearInterval(asking);
      asking = undefined;
      say("Live: this page follows what happens.");
    });
    stream.addEventListener("changed", refresh);
    stream.addEventListener("error", () => {
      if (asking === undefined) {
        // The browser tries to open the stream again by itself, unless it was refused.
        asking = setInterval(refresh, BETWEEN_ASKING);
        say("Connecting again. Until then, what has changed is fetched every 10 seconds.");
      }
    });
  }

  function close() {
    stream?.close();
    stream = undefined;
    clearInterval(asking);
    asking = undefined;
  }

  // A browser has six lines to a server for all its tabs: one that nobody sees gives its own back.
  function followIfSeen() {
    if (document.visibilityState === "hidden") {
      close();
    } else if (!stream) {
      open();
    }
  }
  followIfSeen();
  document.addEventListener("visibilitychange", followIfSeen);
  addEventListener("pagehide", close);
  addEventListener("pageshow", followIfSeen);
}
