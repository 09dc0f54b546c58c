/**
 * On the first page: whether this browser has what the study needs. A plain script in old words, since a browser
 * that lacks something may not read the others at all. The page has the texts; this shows those that apply.
 */

(function () {
  "use strict";

  /** @returns {boolean} whether the browser says that it may play the videos */
  function playsVideos() {
    var video = document.createElement("video");
    return !!video.canPlayType && video.canPlayType('video/mp4; codecs="avc1.42E01E"') !== "";
  }

  function look() {
    var has = {
      scripts: document.documentElement.getAttribute("data-modules") === "ready",
      layout: "CSSLayerBlockRule" in window,
      videos: playsVideos()
    };
    var door = document.getElementById("door");
    var lines = door ? door.querySelectorAll("[data-needs]") : [];
    for (var index = 0; index < lines.length; index += 1) {
      var lacks = !has[lines[index].getAttribute("data-needs")];
      lines[index].hidden = !lacks;
      if (lacks) {
        door.hidden = false;
      }
    }
  }

  // By then every module of the page has run, or has failed to.
  window.addEventListener("load", look);
})();
