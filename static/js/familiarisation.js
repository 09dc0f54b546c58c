/**
 * The familiarisation page: one player that goes through a list of videos by itself.
 */

import { Clip } from "./clip.js";
import { announce, byId, focusHeading, stateOfPage, wantsLessMotion, within } from "./dom.js";
import { listenForKeys } from "./keys.js";
import { Preloader } from "./preloader.js";

/** A rest between two videos, so that one can be told from the next. */
const REST_MS = 800;

const reel = byId("reel");
const { videos, required } = /** @type {{videos: import("./api.js").Recording[], required: number}} */ (stateOfPage().familiarisation);
const key = `pbpo:watched:${reel.dataset.slug}`;
const preloader = new Preloader();
const previous = /** @type {HTMLButtonElement} */ (byId("previous"));
const next = /** @type {HTMLButtonElement} */ (byId("next"));
const leave = /** @type {HTMLButtonElement} */ (byId("continue"));

/** @type {Set<string>} */
const watched = new Set(kept());
let index = Math.max(0, videos.findIndex(({ url }) => !watched.has(url)));
let playsByItself = !wantsLessMotion();
/** @type {ReturnType<typeof setTimeout> | undefined} */
let rest;

const clip = new Clip(within(reel, ".player"), preloader, {
  onReady: () => {
    if (playsByItself) {
      play();
    }
    preloader.want(videos.slice(index + 1, index + 3).map(({ url }) => url));
  },
  onStalled: () => {},
  onFailed: () => {},
  onHesitating: () => {},
  onEvent: () => {},
});
const { video } = clip;

/** @param {number} to */
function go(to) {
  if (to < 0 || to >= videos.length) {
    return;
  }
  clearTimeout(rest);
  index = to;
  preloader.settle([videos[index].url]);
  clip.show(videos[index].url);
  byId("position").textContent = `Video ${index + 1} of ${videos.length}`;
  previous.setAttribute("aria-disabled", String(index === 0));
  next.setAttribute("aria-disabled", String(index === videos.length - 1));
}

function play() {
  playsByItself = true;
  video.play().catch((error) => {
    if (error.name === "NotAllowedError") {
      playsByItself = false; // the Play button starts it
      label();
    }
  });
}

function toggle() {
  clearTimeout(rest);
  if (video.paused) {
    play();
  } else {
    playsByItself = false;
    video.pause();
  }
}

function label() {
  byId("toggle-label").textContent = video.ended ? "Play again" : video.paused ? "Play" : "Pause";
}

function ended() {
  watched.add(videos[index].url);
  keep();
  count();
  if (index < videos.length - 1 && playsByItself) {
    rest = setTimeout(() => go(index + 1), REST_MS);
  } else if (index === videos.length - 1) {
    announce("That was the last video.");
  }
}

function count() {
  const seen = videos.filter(({ url }) => watched.has(url)).length;
  byId("watched").textContent = `${seen} watched`;
  /** @type {HTMLProgressElement} */ (byId("watched-bar")).value = seen;
  /** @type {HTMLInputElement} */ (byId("watched-field")).value = String(seen);
  const missing = Math.max(0, required - seen);
  leave.disabled = missing > 0;
  byId("continue-note").textContent = missing > 0 ? `Watch ${missing} more to continue.` : "";
}

/** @returns {string[]} */
function kept() {
  try {
    return JSON.parse(sessionStorage.getItem(key) ?? "[]");
  } catch {
    return [];
  }
}

function keep() {
  try {
    sessionStorage.setItem(key, JSON.stringify([...watched]));
  } catch {
    // Then a refresh starts the count again.
  }
}

for (const event of ["play", "playing", "pause", "ended", "emptied"]) {
  video.addEventListener(event, label);
}
video.addEventListener("ended", ended);

/**
 * @param {HTMLElement} button
 * @param {() => void} action
 */
function onPress(button, action) {
  button.addEventListener("click", (event) => {
    if (event.detail > 0) {
      focusHeading(); // so that the keys go on working after a press with mouse or finger
    }
    action();
  });
}
onPress(previous, () => go(index - 1));
onPress(next, () => go(index + 1));
onPress(byId("toggle"), toggle);
listenForKeys({
  ArrowLeft: () => { go(index - 1); return true; },
  ArrowRight: () => { go(index + 1); return true; },
  " ": () => { toggle(); return true; },
});

count();
go(index);
label();
