/**
 * Keys of a page. They never take a key away from the control that has the focus, nor from a page that it would
 * scroll: a person who scrolls must not answer by it.
 */

/** What uses the arrow keys itself while it has the focus. */
const FIELDS = "input, select, textarea, [contenteditable], video[controls]";

/** What Space and Enter press while it has the focus. */
const CONTROLS = `${FIELDS}, a[href], button, summary, [tabindex="0"]`;

/** The direction in which a browser scrolls by a key. */
const SCROLLS = new Map(
  /** @type {[string, "x" | "y"][]} */ ([
    ["ArrowLeft", "x"],
    ["ArrowRight", "x"],
    ["ArrowUp", "y"],
    ["ArrowDown", "y"],
    ["PageUp", "y"],
    ["PageDown", "y"],
    ["Home", "y"],
    ["End", "y"],
    [" ", "y"],
  ]),
);

/**
 * @param {"x" | "y"} direction
 * @returns {boolean} whether there is more of the page in this direction than is in sight
 */
function scrolls(direction) {
  const { scrollWidth, clientWidth, scrollHeight, clientHeight } = document.documentElement;
  const isMagnified = (window.visualViewport?.scale ?? 1) > 1.01;
  return isMagnified || (direction === "x" ? scrollWidth > clientWidth : scrollHeight > clientHeight);
}

/** Take the names of keys from the buttons that the page needs for scrolling, as long as it does. */
function showKeys() {
  for (const direction of /** @type {const} */ (["x", "y"])) {
    document.documentElement.toggleAttribute(`data-scrolls-${direction}`, scrolls(direction));
  }
}

/** @param {string} key */
function isTaken(key) {
  const taking = key.startsWith("Arrow") ? FIELDS : CONTROLS;
  return document.activeElement?.matches(taking) ?? false;
}

/**
 * @param {Record<string, (event: KeyboardEvent) => boolean>} bindings by `KeyboardEvent.key`; each returns whether it took the key
 */
export function listenForKeys(bindings) {
  document.addEventListener("keydown", (event) => {
    const action = bindings[event.key];
    if (!action || event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || event.shiftKey || isTaken(event.key)) {
      return;
    }
    const direction = SCROLLS.get(event.key);
    if (direction && scrolls(direction)) {
      return;
    }
    // A key held down says one thing once.
    if (event.repeat || action(event)) {
      event.preventDefault();
    }
  });
  showKeys();
  window.addEventListener("resize", showKeys);
  window.visualViewport?.addEventListener("resize", showKeys);
  if ("ResizeObserver" in window) {
    new ResizeObserver(showKeys).observe(document.body);
  }
}
