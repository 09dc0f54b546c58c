/**
 * The familiarisation page: one player that goes through a list of videos by itself.
 */

import { Refused, SessionApi, mayPass } from "./api.js";
import { Player } from "./player.js";
import { announce, byId, focusHeading, pause, stateOfPage, wantsLessMotion, within } from "./dom.js";
import { isReady, showFailure } from "./failure.js";
import { store, stored } from "./storage.js";
import { listenForKeys } from "./keys.js";
import { Preloader } from "./preloader.js";
import { gettext } from "./i18n.js";

/** A rest between two videos, so that one can be told from the next. */
const REST_MS = 800;

/** Seconds until what was watched is told the server again, if it could not be reached; the last one repeats. */
const RETRY_S = [1, 2, 4, 8];

const reel = byId("reel");
const slug = reel.dataset.slug ?? "";
const api = new SessionApi(slug);
const familiarisation = /** @type {NonNullable<import("./api.js").State["familiarisation"]>} */ (stateOfPage().familiarisation);
const { videos, required } = familiarisation;
const speedKey = `pbpo:speed:${slug}`;
const preloader = new Preloader();
const previous = /** @type {HTMLButtonElement} */ (byId("previous"));
const next = /** @type {HTMLButtonElement} */ (byId("next"));
const leave = /** @type {HTMLButtonElement} */ (byId("continue"));

/** Places of the videos watched to the end, as the server knows them. */
const watched = new Set(familiarisation.watched);
let index = Math.max(0, videos.findIndex((_, place) => !watched.has(place)));
let playsByItself = !wantsLessMotion();
/** @type {ReturnType<typeof setTimeout> | undefined} */
let rest;

const player = new Player(within(reel, ".player"), preloader, {
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
const { video } = player;
const speedButtons = /** @type {HTMLButtonElement[]} */ ([...reel.querySelectorAll("button[data-speed]")]);

/** @param {number} to */
function go(to) {
  if (to < 0 || to >= videos.length) {
    return;
  }
  clearTimeout(rest);
  index = to;
  preloader.settle([videos[index].url]);
  player.show(videos[index].url);
  byId("position").textContent = gettext("Video %(number)s of %(total)s", { number: index + 1, total: videos.length });
  previous.setAttribute("aria-disabled", String(index === 0));
  next.setAttribute("aria-disabled", String(index === videos.length - 1));
}

function play() {
  playsByItself = true;
  Promise.resolve(video.play()).catch((error) => {
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
  byId("toggle-label").textContent = video.ended ? gettext("Play again") : video.paused ? gettext("Play") : gettext("Pause");
}

function ended() {
  if (!watched.has(index)) {
    tell(index);
  }
  if (index < videos.length - 1 && playsByItself) {
    rest = setTimeout(() => go(index + 1), REST_MS);
  } else if (index === videos.length - 1) {
    announce(gettext("That was the last video."));
  }
}

/**
 * Tell the server what was watched, until it knows.
 * @param {number} place
 */
async function tell(place) {
  for (let attempt = 0; ; attempt += 1) {
    try {
      const state = await api.watched(place);
      for (const known of state.familiarisation?.watched ?? []) {
        watched.add(known);
      }
      count();
      return;
    } catch (error) {
      if (error instanceof Refused && !error.isPassing) {
        location.reload(); // another tab has gone on: the server shows where
        return;
      }
      if (!mayPass(error)) {
        showFailure(error);
        return;
      }
      byId("continue-note").textContent = gettext("Not saved yet. Trying again.");
      await pause(RETRY_S[Math.min(attempt, RETRY_S.length - 1)]);
    }
  }
}

function count() {
  const seen = watched.size;
  const remain = videos.length - seen;
  byId("watched").textContent = remain > 0 ? gettext("%(seen)s watched, %(remain)s remain", { seen, remain }) : gettext("All watched");
  /** @type {HTMLProgressElement} */ (byId("watched-bar")).value = seen;
  const missing = Math.max(0, required - seen);
  const opens = leave.disabled && missing === 0;
  leave.disabled = missing > 0;
  byId("continue-note").textContent = missing > 0 ? gettext("Watch %(count)s more to continue.", { count: missing }) : "";
  if (opens && required > 0) {
    announce(gettext("You can start the comparisons."));
  }
}

/** @param {number} speed */
function useSpeed(speed) {
  // The default as well: a browser goes back to it with every new video.
  video.defaultPlaybackRate = speed;
  video.playbackRate = speed;
  for (const button of speedButtons) {
    button.setAttribute("aria-pressed", String(Number(button.dataset.speed) === speed));
  }
  store("sessionStorage", speedKey, speed);
}

/** @returns {number} the speed last chosen, if it is still offered */
function keptSpeed() {
  const before = Number(stored("sessionStorage", speedKey) ?? NaN);
  return familiarisation.speeds.includes(before) ? before : familiarisation.speeds[0];
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
for (const button of speedButtons) {
  onPress(button, () => useSpeed(Number(button.dataset.speed)));
}
listenForKeys({
  ArrowLeft: () => { go(index - 1); return true; },
  ArrowRight: () => { go(index + 1); return true; },
  " ": () => { toggle(); return true; },
});

leave.disabled = required > watched.size;
count();
useSpeed(keptSpeed());
go(index);
label();
isReady();
