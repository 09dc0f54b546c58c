/**
 * One player: a <video> that is reused from query to query, and over it what there is to say when it cannot
 * play. A video that fails is tried again by itself, and by a button: there is no dead end.
 *
 * @typedef {"loading" | "ready" | "stalled" | "failed"} PlayerState
 * @typedef {{
 *   onReady: (player: Player) => void,
 *   onStalled: (player: Player) => void,
 *   onFailed: (player: Player) => void,
 *   onHesitating: () => void,
 *   onEvent: (event: string, player: Player) => void,
 * }} PlayerListener
 */

import { within } from "./dom.js";
import { gettext } from "./i18n.js";

/** A video that takes longer than this to come is being made: the page says that it will come. */
const SAY_MORE_MS = 2500;

/** Seconds until a failed video is tried again; the last one repeats. */
const RETRY_S = [1, 2, 4, 8, 15];

/** Seconds without a byte after which a loading video counts as failed. */
const SILENCE_S = 10;

/** The same before the first byte: a server may have to make the video, and a busy one takes its time. */
const MAKING_S = 40;

/** A hiccup shorter than this is not worth a word. */
const STALL_MS = 200;

/** With this much to show but no promise of reaching the end without a halt, start anyway. */
const PATIENCE_MS = 1000;

/** What is said over a player in each of its states. */
const SAID = {
  loading: gettext("Loading"),
  stalled: gettext("Waiting for the video"),
  failed: gettext("This video did not load."),
  ready: "",
};

export class Player {
  /** @type {PlayerState} */
  state = "loading";
  url = "";
  #turn = 0;
  #attempt = 0;
  /** Whether a failed video is being loaded again by its address, which may take its time as well. */
  #trying = false;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #patience;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #watchdog;

  /**
   * @param {HTMLElement} player
   * @param {import("./preloader.js").Preloader} preloader
   * @param {PlayerListener} listener
   */
  constructor(player, preloader, listener) {
    this.player = player;
    this.side = player.dataset.side ?? "";
    this.video = /** @type {HTMLVideoElement} */ (within(player, "video"));
    this.preloader = preloader;
    this.listener = listener;
    this.note = within(player, ".player-note");
    this.text = within(player, ".player-note > p");
    this.button = within(player, ".player-note > button");
    this.button.addEventListener("click", () => this.retry());

    const video = this.video;
    // Set here as well as in the page: some browsers ask the property, not the attribute, before they autoplay.
    video.muted = true;
    video.addEventListener("canplaythrough", () => this.#becomeReady());
    video.addEventListener("canplay", () => this.#canPlay());
    video.addEventListener("waiting", () => this.#wait());
    video.addEventListener("error", () => this.#failIfCurrent());
    video.addEventListener("progress", () => this.#watch());
    video.addEventListener("suspend", () => this.#hesitate());
    video.addEventListener("loadedmetadata", () => this.#shape());
  }

  get isReady() {
    return this.state === "ready";
  }

  /** Whether all of the video is here, so that the line is free for others. */
  get isWhole() {
    const { buffered, duration } = this.video;
    return this.isReady && buffered.length > 0 && buffered.end(buffered.length - 1) >= duration - 0.1;
  }

  /** @param {string} url */
  show(url) {
    this.url = url;
    this.#attempt = 0;
    this.#turn += 1;
    this.#enter("loading");
    const source = this.preloader.source(url);
    if (typeof source === "string") {
      this.#use(source);
    } else {
      const turn = this.#turn;
      this.#watch();
      source.then((value) => turn === this.#turn && this.#use(value));
    }
  }

  /** Try a failed video again now. */
  async retry() {
    clearTimeout(this.#timer);
    const turn = (this.#turn += 1);
    this.listener.onEvent("retry", this);
    this.text.textContent = gettext("Trying again");
    this.button.hidden = true;
    const source = await this.preloader.again(this.url);
    if (turn !== this.#turn) {
      return;
    }
    if (source) {
      this.#use(source);
    } else if (this.preloader.isMissing(this.url)) {
      this.#fail();
    } else {
      // A site may let its videos be played and not be read by scripts: the player asks for itself.
      this.#trying = true;
      this.#use(this.url);
    }
  }

  /** @param {string} source */
  #use(source) {
    this.video.playbackRate = this.video.defaultPlaybackRate;
    this.video.src = source;
    this.video.load();
    this.#watch();
  }

  #canPlay() {
    const turn = this.#turn;
    if (this.state === "stalled") {
      this.#becomeReady();
    } else {
      setTimeout(() => turn === this.#turn && this.video.readyState >= HTMLMediaElement.HAVE_FUTURE_DATA && this.#becomeReady(), PATIENCE_MS);
    }
  }

  #becomeReady() {
    if (this.state === "ready" || !this.video.currentSrc) {
      return;
    }
    const recovered = this.state !== "loading";
    clearTimeout(this.#timer);
    clearTimeout(this.#watchdog);
    this.#attempt = 0;
    this.#enter("ready");
    if (recovered) {
      this.listener.onEvent("recovered", this);
    }
    this.listener.onReady(this);
  }

  #wait() {
    const turn = this.#turn;
    setTimeout(() => {
      const { video } = this;
      const dry = video.readyState < HTMLMediaElement.HAVE_FUTURE_DATA && !video.ended && !video.seeking;
      if (turn === this.#turn && this.state === "ready" && !video.paused && dry) {
        this.#enter("stalled");
        this.#watch();
        this.listener.onEvent("stall", this);
        this.listener.onStalled(this);
      }
    }, STALL_MS);
  }

  /** The browser stopped loading and still has too little to play: it may want a press first (phones saving data). */
  #hesitate() {
    const turn = this.#turn;
    setTimeout(() => {
      const { readyState, networkState } = this.video;
      const idle = networkState === HTMLMediaElement.NETWORK_IDLE && readyState < HTMLMediaElement.HAVE_FUTURE_DATA;
      if (turn === this.#turn && this.state === "loading" && idle) {
        clearTimeout(this.#watchdog);
        this.listener.onHesitating();
      }
    }, PATIENCE_MS);
  }

  /** Start counting the silence anew. */
  #watch() {
    clearTimeout(this.#watchdog);
    if (this.state === "ready" || (this.state === "failed" && !this.#trying)) {
      return;
    }
    const turn = this.#turn;
    const patience = this.video.readyState === HTMLMediaElement.HAVE_NOTHING ? MAKING_S : SILENCE_S;
    this.#watchdog = setTimeout(() => turn === this.#turn && !this.isReady && this.#fail(), patience * 1000);
  }

  #failIfCurrent() {
    // Taking a source away also reports an error; that one means nothing.
    if (this.video.getAttribute("src")) {
      this.#fail();
    }
  }

  #fail() {
    clearTimeout(this.#timer);
    clearTimeout(this.#watchdog);
    this.#turn += 1;
    this.#enter("failed");
    this.listener.onEvent("error", this);
    this.listener.onFailed(this);
    const wait = RETRY_S[Math.min(this.#attempt, RETRY_S.length - 1)];
    this.#attempt += 1;
    this.#timer = setTimeout(() => this.retry(), wait * 1000);
  }

  /** @param {PlayerState} state */
  #enter(state) {
    clearTimeout(this.#timer);
    this.#trying = false;
    this.state = state;
    this.player.dataset.state = state;
    this.note.hidden = state === "ready";
    const hadFocus = document.activeElement === this.button;
    this.button.hidden = state !== "failed";
    if (hadFocus && this.button.hidden) {
      this.button.blur();
    }
    clearTimeout(this.#patience);
    if (state === "loading") {
      this.#patience = setTimeout(() => (this.text.textContent = gettext("Still preparing this video. It starts by itself.")), SAY_MORE_MS);
    }
    this.text.textContent = SAID[state];
  }

  #shape() {
    const { videoWidth: width, videoHeight: height } = this.video;
    if (width > 0 && height > 0) {
      const frame = this.player.closest("main") ?? this.player;
      frame.style.setProperty("--aspect", `${width} / ${height}`);
      frame.style.setProperty("--aspect-number", String(width / height));
    }
  }
}
