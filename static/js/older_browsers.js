/**
 * Browsers without CSS cascade layers (Firefox before 97, Chrome before 99) get the same rules outside of layers.
 * A plain script in old words, in the head: the page is not shown before it is styled.
 */

(function () {
  "use strict";

  if (!("CSSLayerBlockRule" in window)) {
    var link = document.createElement("link");
    link.rel = "stylesheet";
    link.href = (document.documentElement.getAttribute("data-root") || "") + "/styles/without-layers.css";
    document.head.appendChild(link);
  }
})();
