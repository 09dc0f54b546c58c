/**
 * Where the scripts of a page do not begin to work (one did not load, or failed), this says so, and on the query page
 * lets the pair be watched and answered all the same: by the page's own form, which a browser sends without any script.
 * A plain script in old words, since a browser that lacks something may not read the others at all.
 */

(function () {
  "use strict";

  /** As on the page that works: a press this soon was meant for the pair before. */
  var GUARD_MS = 700;

  /** @param {string} id */
  function byId(id) {
    return document.getElementById(id);
  }

  /** @returns {number} */
  function now() {
    return window.performance && performance.now ? performance.now() : Date.now();
  }

  /** @param {NodeListOf<HTMLElement>} elements */
  function hide(elements) {
    for (var index = 0; index < elements.length; index += 1) {
      elements[index].hidden = true;
    }
  }

  /** @param {HTMLFormElement} form */
  function answerByForm(form) {
    var query = JSON.parse(byId("state").textContent).query;
    var left = form.querySelector('.player[data-side="left"] video');
    var right = form.querySelector('.player[data-side="right"] video');
    var answers = form.querySelectorAll('button[name="response"]');
    var began = { left: 0, right: 0 };
    var bothBegan = 0;

    function open() {
      for (var index = 0; index < answers.length; index += 1) {
        answers[index].disabled = false;
        answers[index].setAttribute("aria-disabled", "false");
      }
    }

    function play() {
      byId("start").hidden = true;
      left.currentTime = 0;
      right.currentTime = 0;
      left.play();
      right.play();
    }

    /** @param {"left" | "right"} side */
    function playing(side) {
      began[side] = began[side] || now();
      if (!bothBegan && began.left && began.right) {
        bothBegan = Math.max(began.left, began.right);
        if (!query.watch_once) {
          setTimeout(open, GUARD_MS);
        }
      }
    }

    function ended() {
      if (left.ended && right.ended) {
        open();
        byId("start").hidden = false;
      }
    }

    hide(form.querySelectorAll(".player-note, .pair-side, .pair-enlarge, .replay, .key"));
    left.addEventListener("playing", function () { playing("left"); });
    right.addEventListener("playing", function () { playing("right"); });
    left.addEventListener("ended", ended);
    right.addEventListener("ended", ended);
    left.src = query.left.url;
    right.src = query.right.url;
    form.querySelector('.player[data-side="left"]').setAttribute("data-state", "ready");
    form.querySelector('.player[data-side="right"]').setAttribute("data-state", "ready");
    byId("start").hidden = false;
    byId("start").querySelector("button").addEventListener("click", play);
    form.addEventListener("submit", function () {
      form.querySelector('[name="rt_ms"]').value = bothBegan ? Math.round(now() - bothBegan) : "";
    });
  }

  // By then every module of the page has run, or has failed to.
  window.addEventListener("load", function () {
    if (document.documentElement.hasAttribute("data-ready")) {
      return;
    }
    byId("failure").hidden = false;
    var form = byId("pair");
    if (form) {
      byId("failure-answer").hidden = false;
      answerByForm(form);
    }
  });
})();
