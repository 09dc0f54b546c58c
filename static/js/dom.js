/**
 * The few things every page script needs of the document.
 */

/**
 * @param {string} id
 * @returns {HTMLElement}
 */
export function byId(id) {
  const element = document.getElementById(id);
  if (!element) {
    throw new Error(`expected an element with id "${id}" on this page`);
  }
  return element;
}

/**
 * The element a selector names inside a root; the page is broken without it.
 * @param {ParentNode} root
 * @param {string} selector
 * @returns {HTMLElement}
 */
export function within(root, selector) {
  const element = root.querySelector(selector);
  if (!(element instanceof HTMLElement)) {
    throw new Error(`expected "${selector}" on this page`);
  }
  return element;
}

/**
 * The state of the session the server put into the page.
 * @returns {import("./api.js").State}
 */
export function stateOfPage() {
  return JSON.parse(byId("state").textContent ?? "");
}

/** Move the focus to the page's heading: it is read out, and no control holds the focus. */
export function focusHeading() {
  const heading = document.querySelector('h1[tabindex="-1"]');
  if (heading instanceof HTMLElement) {
    heading.focus({ preventScroll: true });
  }
}

/** How long one announcement stands before the next: what is replaced sooner is not read. */
const STANDS_MS = 700;

/** @type {string[]} */
const announcements = [];
let isAnnouncing = false;

/**
 * Say something to those who do not see the page, after what is being said.
 * @param {string} text
 */
export function announce(text) {
  if (!announcements.includes(text)) {
    announcements.push(text);
  }
  if (!isAnnouncing) {
    announceNext();
  }
}

function announceNext() {
  const text = announcements.shift();
  isAnnouncing = text !== undefined;
  if (text !== undefined) {
    byId("announcer").textContent = text;
    setTimeout(announceNext, STANDS_MS);
  }
}

/** @returns {boolean} whether the reader asked for less motion */
export function wantsLessMotion() {
  return window.matchMedia?.("(prefers-reduced-motion: reduce)").matches ?? false;
}

const loadedAt = Date.now();

/** @returns {number} milliseconds on a clock that runs on evenly, which is the one of events */
export function now() {
  return globalThis.performance?.now ? performance.now() : Date.now() - loadedAt;
}

/**
 * Do what goes with something else, and must not stand in its way.
 * @param {() => void} action
 */
export function attempt(action) {
  try {
    action();
  } catch (error) {
    console.error(error);
  }
}

/**
 * @param {number} seconds
 * @returns {Promise<void>}
 */
export function pause(seconds) {
  return new Promise((resolve) => setTimeout(resolve, seconds * 1000));
}
