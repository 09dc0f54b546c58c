/**
 * The query page: shows a pair, takes one response to it, and goes on to what the server says comes next.
 */

import { AnswerButtons } from "./answers.js";
import { Refused, SessionApi, mayPass } from "./api.js";
import { announce, attempt, byId, focusHeading, now, pause, stateOfPage, within } from "./dom.js";
import { EvidenceLog } from "./evidence.js";
import { isReady, showFailure } from "./failure.js";
import { sendByForm } from "./form.js";
import { listenForKeys } from "./keys.js";
import { Outbox } from "./outbox.js";
import { Eta } from "./eta.js";
import { SyncedPair } from "./synced_pair.js";
import { Preloader } from "./preloader.js";
import { pressedWith } from "./pressed_with.js";
import { standing, watchStanding } from "./standing.js";
import { SkipReasons } from "./skip_reasons.js";
import { Fullscreen } from "./fullscreen.js";
import { Undo } from "./undo.js";
import { gettext } from "./i18n.js";

/** A press this soon after both videos of a new pair have begun to play was meant for the pair before. */
const GUARD_MS = 700;

/** Seconds after both videos play at which the server is asked what to preload; it is still working it out. */
const ASK_AHEAD_S = [1, 2, 4, 8];

/** Pairs in a row that may be replaced because a video is missing: if nothing is there, nobody must be led in circles. */
const MOST_MISSING = 3;

/** Pairs in a row that were set aside without playing, or milliseconds without one that plays, after which no other will. */
const MOST_UNPLAYED = 3;
const UNPLAYED_MS = 60_000;

/** How long, once the new pair plays, the page still says what became of the one before; or says it before it goes. */
const SAY_BEFORE_S = 4;

/** How often it is looked at whether anything plays at all. */
const LOOK_MS = 5_000;

/** If a pair takes longer than this to play, the page says which one it is all the same. */
const SAY_ANYWAY_MS = 1500;

const slug = byId("query").dataset.slug ?? "";
const api = new SessionApi(slug);
const preloader = new Preloader();
const evidence = new EvidenceLog();
const eta = new Eta(slug);
const skipReasons = new SkipReasons(byId("reasons"));
const heading = within(document, "h1");
const question = heading.textContent ?? "";
const start = byId("start");
const notice = byId("notice");
const noticeAction = byId("notice-action");
const stage = byId("pair");
const faultButton = byId("fault");

let state = stateOfPage();
/** @type {import("./api.js").Query} */
let query = /** @type {import("./api.js").Query} */ (state.query);
/** Grows with every pair: what was started for one pair leaves the next alone. */
let turn = 0;
let shownAt = 0;
let sending = false;
let missing = 0;
/** Pairs in a row that did not play, and when the first of them came. */
let unplayed = 0;
let unplayedSince = 0;
/** Whether both videos of this pair were seen to their end, or need not be. */
let seen = true;
/** Whether this pair has played for so long that a press is meant for it. */
let settled = false;

const pair = new SyncedPair(within(stage, '.player[data-side="left"]'), within(stage, '.player[data-side="right"]'), preloader, {
  onFirstPlaying(at) {
    evidence.bothPlaying(at);
    missing = 0;
    unplayed = 0;
    const mine = turn;
    const settle = () => {
      if (mine === turn) {
        settled = true;
        open();
      }
    };
    setTimeout(settle, Math.max(0, at + GUARD_MS - now()));
    lookAhead(mine);
  },
  onSeen() {
    if (!seen) {
      seen = true;
      heading.textContent = question;
      announce(gettext("You can choose now."));
      open();
    }
  },
  onNeedsPress() {
    start.hidden = false;
    announce(gettext("Press Play both to start the videos."));
    say();
  },
  onNoPressNeeded() {
    start.hidden = true;
  },
  onMissing(side) {
    missing += 1;
    if (missing <= MOST_MISSING) {
      setAside(`the ${side} video is missing`);
    } else {
      sayNothingPlays();
    }
  },
  onEvent: (event, side, value) => evidence.add(event, side, value ?? null),
});
attempt(() => watchStanding(pair.left.player, pair.right.player, (event, value) => evidence.add(event, null, value)));
const buttons = new AnswerButtons(stage, (response, event) => respond(response, event));
const undo = new Undo(byId("undo"), (queryId) => takeBack(queryId));
new Fullscreen(byId("enlarge"), (enlarged) => evidence.add("fullscreen", null, enlarged ? 1 : 0));
const outbox = new Outbox(api, {
  onLate: () => warn(gettext("Not saved yet. Your answer is kept here, and sent again by itself."), gettext("Try now"), () => outbox.tryNow()),
  onSaved: () => announce(gettext("Saved.")),
});

/** Put the query of `state` onto the page. */
function show() {
  query = /** @type {import("./api.js").Query} */ (state.query);
  turn += 1;
  shownAt = now();
  if (unplayed === 0) {
    unplayedSince = shownAt;
  }
  sending = false;
  settled = false;
  seen = !query.watch_once;
  heading.textContent = seen ? question : gettext("Watch both to the end");
  skipReasons.dismiss();
  start.hidden = true;
  notice.hidden = true;
  faultButton.setAttribute("aria-disabled", "false");
  buttons.reset(query.skip);
  undo.offer(query.undo);
  evidence.begin();
  attempt(() => evidence.add("layout", null, standing(pair.left.player, pair.right.player)));
  preloader.settle([query.left.url, query.right.url]);
  pair.show(query.left.url, query.right.url);
  stand();
  // Away from the button that was pressed, and to the same place for every pair: nothing shows which side was
  // chosen last, the keys work, and nothing is pressed again by mistake.
  focusHeading();
  window.scrollTo?.(0, 0);
  const mine = turn;
  setTimeout(() => mine === turn && say(), SAY_ANYWAY_MS);

  const kept = outbox.unsaved(query.id);
  if (kept) {
    send(kept);
  }
}

/** Open the buttons if the pair can be answered. */
function open() {
  if (settled) {
    say();
  }
  buttons.isOpen = !sending && settled && seen;
}

/** How long it still takes; in the practice, and right after it, what its answers are for stands there instead. */
function sayTimeLeft() {
  const { trial, query: number } = state.progress;
  const afterPractice = state.study.stages.includes("practice") && trial === 1 && number === 1;
  if (state.stage === "query" && !afterPractice) {
    byId("time-left").textContent = eta.left(state.progress, state.study.break_s);
  }
}

/** Write where one is, at once: a press that changed nothing on the page would seem lost. */
function stand() {
  const { trial, trials, query: number, queries, at_most: mayEndEarly } = state.progress;
  const practising = state.stage === "practice";
  const part = practising ? gettext("Practice") : gettext("Part %(number)s of %(total)s", { number: trial, total: trials });
  const place = mayEndEarly
    ? gettext("Pair %(number)s of at most %(total)s", { number, total: queries })
    : gettext("Pair %(number)s of %(total)s", { number, total: queries });
  byId("progress").textContent = `${part} · ${place}`;
  const bar = /** @type {HTMLProgressElement} */ (byId("progress-bar"));
  bar.max = practising ? queries : trials * queries;
  bar.value = practising ? number - 1 : (trial - 1) * queries + number - 1;
  sayTimeLeft();
}

/** Speak where one is, once per pair: when it can be answered, or when that takes long. */
function say() {
  const line = byId("progress");
  if (line.dataset.query !== query.id) {
    line.dataset.query = query.id;
    announce((line.textContent ?? "").replace(" · ", ", "));
  }
}

/**
 * @param {import("./api.js").Response} response
 * @param {Event} event
 */
async function respond(response, event) {
  keepKeysWorking(event);
  if (!buttons.isOpen) {
    return;
  }
  if (skipReasons.isOpen) {
    skipReasons.dismiss(); // not skipped after all; a second press on skip only takes it back
    if (response === "skip") {
      return;
    }
  }
  const { id } = query;
  try {
    await take(response, event);
  } catch (error) {
    postInstead({ query_id: id, response, rt_ms: NaN }, error);
  }
}

/**
 * @param {import("./api.js").Response} response
 * @param {Event} event
 */
async function take(response, event) {
  evidence.add("pressed", null, pressedWith(event));
  const offered = response === "skip" ? query.skip?.reasons : undefined;
  const mine = turn;
  const reason = offered ? await skipReasons.ask(offered) : undefined;
  if (offered) {
    focusHeading();
  }
  if (mine !== turn || reason === null) {
    return; // another pair came meanwhile, or the skip was taken back
  }
  const answer = evidence.answer(query.id, response, event.timeStamp, pair);
  await send(reason ? { ...answer, skip_reason: reason } : answer);
}

/**
 * A script of ours has failed: the answer goes the way that needs none.
 * @param {import("./form.js").Sent} answer
 * @param {unknown} error
 */
function postInstead(answer, error) {
  console.error(error);
  attempt(() => warn(gettext("Something in this page has failed. It is our fault. Your answer is being sent another way.")));
  sendByForm(/** @type {HTMLFormElement} */ (stage), answer);
}

/** @param {import("./api.js").Answer} answer */
async function send(answer) {
  sending = true;
  attempt(() => {
    undo.withdraw();
    faultButton.setAttribute("aria-disabled", "true");
    buttons.confirm(answer.response);
    eta.took((now() - shownAt) / 1000);
  });
  let next;
  let told = "";
  try {
    next = await outbox.send(answer);
  } catch (error) {
    if (!(error instanceof Refused)) {
      postInstead(answer, error);
      return;
    }
    told = error.kind === "already-answered" ? gettext("This pair was already answered in another tab.") : "";
    next = error.status === 409 ? await whereNow() : null;
    if (!next) {
      // Signed out, expired, or closed: the server's own page says so.
      warn(gettext("This answer could not be saved."), gettext("Reload the page"), () => location.reload());
      return;
    }
  }
  arrive(next, told);
}

/**
 * Back to the pair before: the answer to it is taken back.
 * @param {string} queryId
 */
async function takeBack(queryId) {
  if (sending) {
    return;
  }
  sending = true;
  buttons.isOpen = false;
  undo.withdraw();
  try {
    arrive(await api.undo(queryId));
    announce(gettext("Your last answer was taken back."));
  } catch (error) {
    sending = false;
    open();
    warn(error instanceof Refused ? gettext("It is too late to undo that answer.") : gettext("The answer could not be taken back."));
  }
}

/**
 * A video of this pair does not play: the server sets the query aside and gives another one for it.
 * @param {string} how it was noticed
 */
async function setAside(how) {
  if (sending) {
    return;
  }
  sending = true;
  undo.withdraw();
  buttons.isOpen = false;
  faultButton.setAttribute("aria-disabled", "true");
  const fault = evidence.fault(query.id, how, pair);
  /** @type {import("./api.js").State | null} */
  let next = null;
  while (!next) {
    try {
      next = await api.reportFault(fault);
    } catch (error) {
      if (error instanceof Refused && !error.isPassing) {
        next = error.status === 409 ? await whereNow() : null;
        if (!next) {
          warn(gettext("This could not be reported."), gettext("Reload the page"), () => location.reload());
          return;
        }
        if (next.query?.id === query.id) {
          // There is no other pair to show: this one may still come to play.
          sending = false;
          faultButton.setAttribute("aria-disabled", "false");
          open();
          warn(gettext("There is no other pair to show right now. If this one still comes, you can answer it."));
          return;
        }
      } else if (mayPass(error)) {
        warn(gettext("The server cannot be reached. Trying again."));
        await pause(2);
      } else {
        showFailure(error);
        return;
      }
    }
  }
  unplayed += pair.hasPlayed ? 0 : 1;
  if (unplayed < MOST_UNPLAYED) {
    arrive(next, gettext("That pair was set aside. Here is another one."));
  } else {
    arrive(next);
    sayNothingPlays();
  }
}

/** Another pair would not help: what may, and the way out, for as long as nothing plays. */
function sayNothingPlays() {
  warn(
    gettext("No video plays here. Your network, or a blocker in your browser, may be stopping them: try another network, or allow this site."),
    gettext("What helps"),
    () => location.assign(byId("query").dataset.trouble ?? ""),
  );
  const mine = turn;
  whenPlays(mine).then(() => mine === turn && (notice.hidden = true));
}

/** @param {number} mine the pair that is waited for; another one ends the wait */
async function whenPlays(mine) {
  while (mine === turn && !pair.hasPlayed) {
    await pause(0.2);
  }
}

/**
 * Go where the server says the session is.
 * @param {import("./api.js").State} next
 * @param {string} [told] what became of the pair before
 */
async function arrive(next, told = "") {
  // From the practice into the first trial, and out of the trials, by a page of its own.
  if (next.stage !== state.stage || !next.query) {
    if (told) {
      warn(told);
      await pause(SAY_BEFORE_S);
    }
    location.reload();
    return;
  }
  state = next;
  try {
    show();
  } catch (error) {
    console.error(error);
    location.reload(); // the server knows the pair: the page begins anew with it
    return;
  }
  if (!told) {
    return;
  }
  warn(told);
  const mine = turn;
  await whenPlays(mine);
  await pause(SAY_BEFORE_S);
  if (mine === turn) {
    notice.hidden = true;
  }
}

/** @returns {Promise<import("./api.js").State | null>} */
async function whereNow() {
  for (;;) {
    try {
      return await api.session();
    } catch (error) {
      if (!mayPass(error)) {
        return null;
      }
      warn(gettext("The server cannot be reached. Trying again."));
      await pause(2);
    }
  }
}

/**
 * While this pair plays, find out what may come next, and fetch it once this pair is here to its end.
 * @param {number} mine
 */
async function lookAhead(mine) {
  while (mine === turn && !pair.isWhole) {
    await pause(0.2);
  }
  if (mine !== turn) {
    return;
  }
  let coming = query.prefetch;
  preloader.want(coming);
  for (const seconds of ASK_AHEAD_S) {
    if (coming.length > 0) {
      return; // what may come next is worked out all at once
    }
    await pause(seconds);
    if (mine !== turn || sending) {
      return;
    }
    const found = await look(mine);
    if (mine !== turn) {
      return; // what the next pair wants stays as it is
    }
    coming = found ?? coming;
    preloader.want(coming);
  }
}

/**
 * Ask the server where the session is; another tab may have answered.
 * @param {number} mine
 * @returns {Promise<string[] | null>} what to fetch ahead
 */
async function look(mine) {
  try {
    const now = await api.session();
    if (mine !== turn || sending) {
      return null;
    }
    if (now.stage !== state.stage || now.query?.id !== query.id) {
      arrive(now);
      return null;
    }
    return now.query.prefetch;
  } catch {
    return null;
  }
}

/**
 * @param {string} text
 * @param {string} [label]
 * @param {() => void} [action]
 */
function warn(text, label, action) {
  const line = byId("notice-text");
  notice.hidden = false;
  if (line.textContent !== text) {
    line.textContent = text;
  }
  noticeAction.hidden = !action;
  noticeAction.textContent = label ?? "";
  noticeAction.onclick = action ?? null;
}

/**
 * A mouse or a finger leaves the focus on what it pressed, and the keys would stop working there.
 * @param {Event} event
 */
function keepKeysWorking(event) {
  if (event instanceof MouseEvent && event.detail > 0) {
    focusHeading();
  }
}

/** @param {Event} event */
function playAgain(event) {
  keepKeysWorking(event);
  if (start.hidden) {
    evidence.replays += 1;
    evidence.add("replay");
  }
  pair.press();
}

within(stage, ".replay").addEventListener("click", playAgain);
byId("enlarge").addEventListener("click", keepKeysWorking);
faultButton.addEventListener("click", (event) => {
  keepKeysWorking(event);
  if (now() - shownAt > GUARD_MS) {
    setAside("pressed");
  }
});
within(start, "button").addEventListener("click", (event) => {
  focusHeading();
  playAgain(event);
});
listenForKeys({
  ArrowLeft: (event) => { respond("left", event); return true; },
  ArrowRight: (event) => { respond("right", event); return true; },
  ArrowDown: (event) => {
    if (query.skip) {
      respond("skip", event);
    }
    return query.skip !== null; // without a skip, Down scrolls as everywhere
  },
  " ": (event) => { playAgain(event); return true; },
});

setInterval(() => {
  const isWaiting = !pair.hasPlayed && start.hidden && !sending && notice.hidden && document.visibilityState !== "hidden";
  if (isWaiting && now() - unplayedSince > UNPLAYED_MS) {
    sayNothingPlays();
  }
}, LOOK_MS);

// Back from another tab, from sleep, or from the browser's own cache: is this still the pair?
document.addEventListener("visibilitychange", () => {
  if (document.visibilityState === "visible" && !sending) {
    look(turn);
  }
});
window.addEventListener("pageshow", (event) => {
  if (event.persisted && !sending) {
    look(turn);
  }
});

// A page that is loaded again for the next pair begins at its top as well.
history.scrollRestoration = "manual";
sayTimeLeft();
show();
isReady();
