/**
 * The second click of a double click does nothing to what may be pressed once: forms, and what is marked `data-once`.
 * It was meant for what the first click has already done, also where that brought another page or another pair.
 */

/** Clicks further apart than this are two. Browsers count by the system's own setting, which may be longer. */
const TOGETHER_MS = 500;

const ONCE = 'button[type="submit"], button:not([type]), [data-once], [data-once] button';

/** On the clock of this page, which began about when the click was made that opened it. */
let before = 0;

document.addEventListener(
  "click",
  (event) => {
    const apart = event.timeStamp - before;
    before = event.timeStamp;
    const isSecond = event.detail > 1 && apart < TOGETHER_MS;
    if (isSecond && event.target instanceof Element && event.target.closest(ONCE)) {
      event.preventDefault();
      event.stopPropagation();
    }
  },
  true,
);
