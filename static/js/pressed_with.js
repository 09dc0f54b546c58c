/**
 * What a press was made with. A click says it itself in newer browsers only; the pointer that went down before says it in all.
 */

let pointer = "mouse";

document.addEventListener(
  "pointerdown",
  (event) => {
    pointer = event.pointerType || pointer;
  },
  true,
);

/**
 * @param {Event} event a click, or a key
 * @returns {string} mouse, touch, pen or keyboard
 */
export function pressedWith(event) {
  const isByPointer = event instanceof MouseEvent && event.detail > 0;
  return isByPointer ? pointer : "keyboard";
}
