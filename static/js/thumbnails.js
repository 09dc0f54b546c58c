/**
 * Thumbnail videos that play while they are hovered, focused or pressed. One that has been rendered shows its first
 * frame when it is scrolled near; one that has not is rendered only on request.
 */

import { wantsLessMotion } from "./dom.js";

const AHEAD = "100px";

/** @param {HTMLVideoElement} video */
function play(video) {
  // A video that cannot be had stays as it is: what there is to know of it stands beside it.
  Promise.resolve(video.play()).catch(() => {});
}

/** @param {HTMLVideoElement} video */
function rest(video) {
  video.pause();
  if (video.readyState > 0) {
    video.currentTime = 0;
  }
}

const watcher = new IntersectionObserver(
  (entries) => {
    for (const { isIntersecting, target } of entries) {
      if (isIntersecting && target instanceof HTMLVideoElement) {
        watcher.unobserve(target);
        target.preload = "metadata";
      }
    }
  },
  { rootMargin: AHEAD },
);

/** Videos that play of themselves while they are in view, until they are pressed. */
const inView = new IntersectionObserver((entries) => {
  for (const { isIntersecting, target } of entries) {
    if (target instanceof HTMLVideoElement) {
      if (isIntersecting) {
        play(target);
      } else {
        target.pause();
      }
    }
  }
});

/** @param {ParentNode} root */
export function watchThumbnails(root) {
  for (const thumb of root.querySelectorAll("[data-thumb]")) {
    const video = thumb.querySelector("video");
    if (!video || !(thumb instanceof HTMLElement)) {
      continue;
    }
    if ("ready" in video.dataset) {
      watcher.observe(video);
    }
    video.loop = true;
    if ("plays" in thumb.dataset && !wantsLessMotion()) {
      inView.observe(video);
      thumb.addEventListener("click", (event) => {
        event.preventDefault();
        inView.unobserve(video);
        if (video.paused) {
          play(video);
        } else {
          video.pause();
        }
      });
      continue;
    }
    if (!wantsLessMotion()) {
      thumb.addEventListener("pointerenter", (event) => {
        if (event instanceof PointerEvent && event.pointerType === "mouse") {
          play(video);
        }
      });
      thumb.addEventListener("focus", () => thumb.matches(":focus-visible") && play(video));
    }
    let playedBefore = false;
    // The pointer or the focus has begun to play it by the time of a click: what counts is how it was before.
    thumb.addEventListener("click", (event) => {
      const again = playedBefore;
      playedBefore = !again;
      if (again) {
        rest(video);
      } else {
        play(video);
      }
      event.preventDefault();
    });
    for (const leaving of ["pointerleave", "blur"]) {
      thumb.addEventListener(leaving, () => {
        playedBefore = false;
        rest(video);
      });
    }
  }
}

watchThumbnails(document);
