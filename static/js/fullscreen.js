/**
 * Enlarges both videos: fullscreen where the browser supports it, otherwise the whole page.
 */

export class Fullscreen {
  /**
   * @param {HTMLElement} button
   * @param {(enlarged: boolean) => void} onChange
   */
  constructor(button, onChange) {
    this.root = document.documentElement;
    this.button = button;
    this.onChange = onChange;
    button.addEventListener("click", () => (this.isEnlarged ? this.#leave() : this.#enter()));
    document.addEventListener("fullscreenchange", () => this.#show(document.fullscreenElement !== null));
    document.addEventListener("keydown", (event) => {
      // The browser leaves fullscreen by itself; of the whole page it knows nothing.
      if (event.key === "Escape" && this.isEnlarged && !document.fullscreenElement) {
        this.#show(false);
      }
    });
  }

  get isEnlarged() {
    return "enlarged" in this.root.dataset;
  }

  async #enter() {
    this.#show(true);
    try {
      await this.root.requestFullscreen();
    } catch {
      // Phones that do not have it, or a browser that refuses: the page is what there is.
    }
  }

  #leave() {
    if (document.fullscreenElement) {
      document.exitFullscreen();
    } else {
      this.#show(false);
    }
  }

  /** @param {boolean} enlarged */
  #show(enlarged) {
    if (enlarged === this.isEnlarged) {
      return;
    }
    if (enlarged) {
      this.root.dataset.enlarged = "";
    } else {
      delete this.root.dataset.enlarged;
    }
    this.button.setAttribute("aria-pressed", String(enlarged));
    this.onChange(enlarged);
  }
}
