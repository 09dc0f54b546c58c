/**
 * The device check: plays a video, measures the page's width and the line, and says what to do if they will not do.
 */

import { Refused, SessionApi, mayPass } from "./api.js";
import { Player } from "./player.js";
import { announce, byId, now, stateOfPage, wantsLessMotion, within } from "./dom.js";
import { isReady, showFailure } from "./failure.js";
import { Preloader } from "./preloader.js";
import { gettext } from "./i18n.js";

/** The line is measured so many times; the best counts, since a first fetch also waits for the video to be made. */
const MEASUREMENTS = 2;

/** A clip that has not ended after so many times its length has not played. */
const PATIENCE = 4;

/** However short it is: a browser may take so long to begin. */
const LEAST_PATIENCE_MS = 3000;

const page = byId("check");
const api = new SessionApi(page.dataset.slug ?? "");
const check = /** @type {NonNullable<import("./api.js").State["device_check"]>} */ (stateOfPage().device_check);
const leave = /** @type {HTMLButtonElement} */ (byId("continue"));
const again = byId("again");
const giveUp = byId("give-up");

/** What to do about each thing that a device may lack. */
const ADVICE = {
  clip: gettext("The video has not played to its end. Press Check again to play it, or try another browser."),
  width: gettext(
    "Make the window wider, turn your device, or use one with a larger screen: the page has to be %(width)s pixels wide.",
    { width: check.min_width_px ?? 0 },
  ),
  line: gettext("Your connection is slow. Close what else uses it, or try another one: it has to carry %(rate)s Mbit/s.", {
    rate: check.min_mbit_s ?? 0,
  }),
};

const ZOOMED = gettext("The page is zoomed in. Please zoom out while you take part: Ctrl or Command, and the minus key. You can zoom in again afterwards.");

/** By how much a window is wider than what is in it, without any zoom: its edges, and a bar at its side. */
const EDGES = 1.15;

/** @returns {boolean} whether it is the zoom that takes the room */
function isZoomed() {
  return window.outerWidth > EDGES * window.innerWidth || (window.visualViewport?.scale ?? 1) > 1.01;
}

/** @typedef {keyof typeof ADVICE} Lack */

/** @type {{width_px: number, played: boolean, mbit_s: number | null}} */
const measured = { width_px: 0, played: false, mbit_s: null };
/** Who asked for less motion starts the video by a press. */
let mayPlay = !wantsLessMotion();
/** @type {Player | null} */
let clip = null;
/** @type {ReturnType<typeof setTimeout> | undefined} */
let patience;

if (check.test_clip) {
  clip = new Player(within(page, ".player"), new Preloader(), {
    onReady: () => (mayPlay ? play() : settle("clip", false)),
    onStalled: () => {},
    onFailed: () => settle("clip", false),
    onHesitating: () => settle("clip", false),
    onEvent: () => {},
  });
  clip.video.addEventListener("ended", () => {
    measured.played = true;
    settle("clip", true);
  });
}

function play() {
  clearTimeout(patience);
  patience = setTimeout(() => measured.played || settle("clip", false), Math.max(LEAST_PATIENCE_MS, check.clip.duration_s * PATIENCE * 1000));
  Promise.resolve(clip?.video.play()).catch((error) => error.name === "NotAllowedError" && settle("clip", false));
}

function measureWidth() {
  // What overflows widens `innerWidth` on phones.
  measured.width_px = Math.min(window.innerWidth, document.documentElement.clientWidth);
  if (check.min_width_px !== null) {
    settle("width", measured.width_px >= check.min_width_px);
  }
}

async function measureLine() {
  for (let turn = 0; turn < MEASUREMENTS; turn += 1) {
    try {
      const response = await fetch(check.clip.url, { cache: "no-store", credentials: "same-origin" });
      const begun = now();
      const size = (await response.blob()).size;
      const seconds = Math.max((now() - begun) / 1000, 0.001);
      if (response.ok) {
        measured.mbit_s = Math.max(measured.mbit_s ?? 0, Math.round((size * 8) / seconds / 1e4) / 100);
      }
    } catch {
      // A line that breaks is a slow one.
    }
  }
  if (check.min_mbit_s !== null) {
    settle("line", (measured.mbit_s ?? 0) >= check.min_mbit_s);
  }
}

/**
 * @param {Lack} name
 * @param {boolean} isGood
 */
function settle(name, isGood) {
  const line = page.querySelector(`[data-check="${name}"]`);
  if (!(line instanceof HTMLElement)) {
    return;
  }
  line.dataset.result = isGood ? "good" : "lacking";
  within(line, ".result").textContent = isGood ? gettext("Yes") : gettext("No");
  show();
}

/** Show what may be done next. */
function show() {
  const lines = /** @type {HTMLElement[]} */ ([...page.querySelectorAll("[data-check]")]);
  const lacking = lines.filter(({ dataset }) => dataset.result === "lacking");
  const isGood = lines.every(({ dataset }) => dataset.result === "good");
  advise(lacking.map(({ dataset }) => /** @type {Lack} */ (dataset.check)));
  const lacks = new Set(lacking.map(({ dataset }) => dataset.check));
  const helps = /** @type {HTMLElement[]} */ ([...page.querySelectorAll("[data-helps]")]);
  const shown = helps.find(({ dataset }) => lacks.has(dataset.helps));
  helps.forEach((link) => (link.hidden = link !== shown));
  again.hidden = lacking.length === 0;
  giveUp.hidden = lacking.length === 0;
  if (leave.disabled && isGood) {
    announce(gettext("Your device is fine. You can continue."));
  }
  leave.disabled = !isGood;
}

/** @param {Lack[]} lacks */
function advise(lacks) {
  const text = lacks.flatMap((name) => (name === "width" && isZoomed() ? [ZOOMED, ADVICE[name]] : [ADVICE[name]]));
  const advice = byId("advice");
  if (advice.textContent !== text.join("")) {
    advice.textContent = "";
    for (const words of text) {
      const line = document.createElement("p");
      line.className = "notice";
      line.textContent = words;
      advice.append(line);
    }
  }
}

function begin() {
  measured.played = false;
  measured.mbit_s = null;
  for (const line of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-check]"))) {
    line.dataset.result = "open";
    within(line, ".result").textContent = gettext("Checking");
  }
  show();
  clip?.show(check.clip.url);
  measureWidth();
  measureLine();
}

async function goOn() {
  leave.disabled = true;
  try {
    await api.passDeviceCheck(measured);
    location.reload();
  } catch (error) {
    leave.disabled = false;
    if (error instanceof Refused && error.status === 409) {
      location.reload(); // another tab has gone on, or the window has become narrower
      return;
    }
    if (!mayPass(error)) {
      showFailure(error);
      return;
    }
    announce(gettext("Not sent yet. Try again."));
    byId("advice").textContent = gettext("The server cannot be reached. Try again in a moment.");
  }
}

window.addEventListener("resize", measureWidth);
again.addEventListener("click", () => {
  mayPlay = true;
  begin();
});
leave.addEventListener("click", goOn);
begin();
isReady();
