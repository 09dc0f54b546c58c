/**
 * On the first page: checks whether this browser supports what the study needs. A plain ES5 script, since a browser
 * without some feature may be unable to parse the modules. The page has the texts; this shows those that apply.
 */

(function () {
  "use strict";

  /**
   * @param {string} format
   * @returns {boolean} whether the browser says that it may play such videos
   */
  function plays(format) {
    var video = document.createElement("video");
    return !!video.canPlayType && video.canPlayType(format) !== "";
  }

  function look() {
    var has = {
      scripts: document.documentElement.getAttribute("data-modules") === "ready",
      layout: !!window.CSS && !!CSS.supports && CSS.supports("aspect-ratio", "16 / 9") && CSS.supports("inset", "0"),
      // The page asks for those that the study's videos have.
      mp4: plays('video/mp4; codecs="avc1.42E01E"'),
      webm: plays("video/webm")
    };
    var notice = document.getElementById("browser-support");
    var lines = notice ? notice.querySelectorAll("[data-needs]") : [];
    for (var index = 0; index < lines.length; index += 1) {
      var lacks = !has[lines[index].getAttribute("data-needs")];
      lines[index].hidden = !lacks;
      if (lacks) {
        notice.hidden = false;
      }
    }
  }

  // By then every module of the page has run, or has failed to.
  window.addEventListener("load", look);
})();
