/**
 * The break between two trials.
 */

import { SessionApi } from "./api.js";
import { Countdown, clockFace } from "./countdown.js";
import { announce, byId, stateOfPage } from "./dom.js";
import { isReady } from "./failure.js";
import { gettext } from "./i18n.js";

const api = new SessionApi(byId("break").dataset.slug ?? "");
const clock = byId("clock");
const button = /** @type {HTMLButtonElement} */ (byId("continue"));
const title = document.title;

/** Seconds left that are worth interrupting a screen reader for. */
const SPOKEN = new Map([[60, gettext("One minute left.")], [10, gettext("Ten seconds left.")]]);

const countdown = new Countdown({
  onTick(secondsLeft) {
    clock.textContent = clockFace(secondsLeft);
    document.title = secondsLeft > 0 ? `${clockFace(secondsLeft)} · ${title}` : title;
    const spoken = SPOKEN.get(secondsLeft);
    if (spoken) {
      announce(spoken);
    }
  },
  onOver() {
    if (button.disabled) {
      button.disabled = false;
      byId("resting").hidden = true;
      byId("over").hidden = false;
      // The focus stays where it is: a key that is pressed just now must not go on.
      announce(gettext("The break is over. You can continue."));
    }
  },
});

countdown.set(stateOfPage().break?.seconds_left ?? 0);

isReady();

// A computer that slept may have stopped the page's clock, and another tab may have moved on: ask the server.
document.addEventListener("visibilitychange", async () => {
  if (document.visibilityState !== "visible") {
    return;
  }
  try {
    const state = await api.session();
    if (state.stage !== "break") {
      location.reload();
    } else if (button.disabled) {
      countdown.set(state.break?.seconds_left ?? 0);
    }
  } catch {
    // Unreachable for now: the page goes on counting, and the server checks when the form is sent.
  }
});
