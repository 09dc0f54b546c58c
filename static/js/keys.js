/**
 * Keys of a page. They work only while no control has the focus, so that they never
 * take a key away from the control that a person is using.
 */

const CONTROLS = 'a[href], button, input, select, textarea, summary, [contenteditable], [tabindex="0"]';

/** @returns {boolean} */
function controlHasFocus() {
  return document.activeElement?.matches(CONTROLS) ?? false;
}

/**
 * @param {Record<string, (event: KeyboardEvent) => boolean>} bindings by `KeyboardEvent.key`; each returns whether it took the key
 */
export function listenForKeys(bindings) {
  document.addEventListener("keydown", (event) => {
    const action = bindings[event.key];
    if (!action || event.ctrlKey || event.metaKey || event.altKey || event.shiftKey || controlHasFocus()) {
      return;
    }
    // A key held down says one thing once; its repeats must not scroll the page either.
    if (event.repeat || action(event)) {
      event.preventDefault();
    }
  });
}
