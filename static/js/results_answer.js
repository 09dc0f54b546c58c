/**
 * The answer on a results page: fetched after the page, since the models behind it take a while to fit.
 */

import { watchThumbnails } from "./thumbnails.js";

const place = document.querySelector("[data-answer]");
if (place instanceof HTMLElement && place.dataset.answer) {
  place.setAttribute("aria-busy", "true");
  try {
    const answer = await fetch(place.dataset.answer, { redirect: "error" });
    if (!answer.ok) {
      throw new Error(`expected the answer, got ${answer.status}`);
    }
    const parsed = new DOMParser().parseFromString(await answer.text(), "text/html");
    place.replaceChildren(...parsed.body.childNodes);
    watchThumbnails(place);
  } catch (error) {
    place.textContent = "What is liked best could not be worked out. Reload the page to try again.";
    console.error(error);
  } finally {
    place.removeAttribute("aria-busy");
  }
}
