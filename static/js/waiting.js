/**
 * The page of a pair whose videos are not recorded yet: counts the time, asks the server, and goes on by itself.
 */

import { Refused, SessionApi, mayPass } from "./api.js";
import { clockFace } from "./countdown.js";
import { announce, byId, now, stateOfPage } from "./dom.js";
import { isReady, showFailure } from "./failure.js";
import { gettext } from "./i18n.js";
import { Undo } from "./undo.js";
import { isLong, pollSeconds } from "./waiting_times.js";

const page = byId("waiting");
const api = new SessionApi(page.dataset.slug ?? "");
const waitedBefore = Number(page.dataset.waited);
const loadedAt = now();
const title = document.title;
const bar = /** @type {HTMLProgressElement | null} */ (document.getElementById("waiting-bar"));
const first = stateOfPage().waiting;
const undo = new Undo(byId("undo"), takeBack);

/** Whether the page is about to be left for the pair. */
let over = false;
let machines = first?.machines ?? 0;
let usually = first?.usually_s ?? null;

function waited() {
  return waitedBefore + (now() - loadedAt) / 1000;
}

function tick() {
  if (over) {
    return;
  }
  const seconds = Math.floor(waited());
  byId("clock").textContent = clockFace(seconds);
  document.title = `${clockFace(seconds)} · ${title}`;
  if (bar) {
    bar.value = Math.min(seconds, bar.max);
  }
  sayWhatIsWrong();
}

function sayWhatIsWrong() {
  show("no-machine", machines === 0);
  const isTooLong = isLong(waited(), usually, machines);
  show("long", isTooLong);
  byId("stop").hidden = !isTooLong;
}

/**
 * Show or hide a notice, and read it out when it appears.
 * @param {string} id
 * @param {boolean} isShown
 */
function show(id, isShown) {
  const notice = byId(id);
  if (notice.hidden === isShown) {
    notice.hidden = !isShown;
    if (isShown) {
      announce(notice.textContent?.trim().replace(/\s+/g, " ") ?? "");
    }
  }
}

async function look() {
  try {
    const state = await api.session();
    if (!state.waiting || state.query) {
      goOn();
      return;
    }
    ({ machines } = state.waiting);
    usually = state.waiting.usually_s;
    const recorded = Boolean(state.waiting.left ?? state.waiting.right);
    if (recorded && !document.querySelector('[data-testid="meanwhile"]')) {
      location.reload(); // one of the two has come: the page shows it
      return;
    }
  } catch (error) {
    if (error instanceof Refused && !error.isPassing) {
      location.reload(); // signed out, expired or closed: the server's own page says so
      return;
    }
    if (!mayPass(error)) {
      showFailure(error);
      return;
    }
  }
  setTimeout(look, pollSeconds(waited()) * 1000);
}

/** The pair is there. In a tab that is not looked at it waits for its person, and the tab's title says so. */
function goOn() {
  if (over) {
    return;
  }
  over = true;
  document.title = gettext("Ready · %(title)s", { title });
  announce(gettext("Your next videos are ready."));
  if (document.visibilityState !== "hidden") {
    location.reload();
  }
}

/** @param {string} queryId */
async function takeBack(queryId) {
  undo.withdraw();
  try {
    await api.undo(queryId);
    location.reload();
  } catch {
    announce(gettext("The answer could not be taken back."));
  }
}

document.addEventListener("visibilitychange", () => {
  if (over && document.visibilityState === "visible") {
    location.reload();
  }
});

undo.offer(first?.undo);
tick();
setInterval(tick, 1000);
setTimeout(look, pollSeconds(waited()) * 1000);
isReady();
