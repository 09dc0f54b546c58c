/**
 * Two players that start on the same frame, stay together, and begin again together.
 *
 * @typedef {{
 *   onFirstPlaying: (at: number) => void,
 *   onSeen: () => void,
 *   onNeedsPress: () => void,
 *   onNoPressNeeded: () => void,
 *   onMissing: (side: string) => void,
 *   onEvent: (event: string, side: string | null, value?: number | null) => void,
 * }} SyncedPairListener
 */

import { Player } from "./player.js";
import { attempt, wantsLessMotion } from "./dom.js";

/** A rest between the end and the next beginning, so that the two can be told apart. */
const REST_MS = 800;

/** How often the two are compared while they play. */
const COMPARE_MS = 200;

/** Comparisons in a row that find a video halted, after which both go on: what halts one is not always the page. */
const MOST_HALTED = 3;

/** Differences of the two clocks, in seconds: left alone below the first, closed by a jump above the second. */
const TOLERATED_S = 0.008;
const JUMP_S = 0.5;

/** In between, the right one runs this much faster or slower at most: too little to be seen. */
const RATE_CHANGE = 0.08;

/** A seek that takes longer than this will not happen. */
const SEEK_MS = 2000;

export class SyncedPair {
  /** @type {"loading" | "press" | "playing" | "held" | "resting"} */
  phase = "loading";
  /** Milliseconds the two were apart at most, in what was played of this pair; and at its first start. */
  worstDrift = 0;
  #turn = 0;
  #pressed = false;
  /** @type {Map<string, number>} */
  #playingAt = new Map();
  #hasPlayed = false;
  #halted = 0;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #rest;

  /**
   * @param {HTMLElement} left
   * @param {HTMLElement} right
   * @param {import("./preloader.js").Preloader} preloader
   * @param {SyncedPairListener} listener
   */
  constructor(left, right, preloader, listener) {
    this.listener = listener;
    /** @type {import("./player.js").PlayerListener} */
    const playerListener = {
      onReady: () => this.#ready(),
      onStalled: () => this.#hold("held"),
      onFailed: (player) => {
        this.#hold("loading");
        if (preloader.isMissing(player.url)) {
          listener.onMissing(player.side);
        }
      },
      onHesitating: () => this.#needPress(),
      onEvent: (event, player) => listener.onEvent(event, player.side),
    };
    this.left = new Player(left, preloader, playerListener);
    this.right = new Player(right, preloader, playerListener);
    for (const player of this.players) {
      player.video.addEventListener("playing", (event) => this.#playing(player, event.timeStamp));
      player.video.addEventListener("ended", (event) => {
        // Of a single frame some browsers say only that it has ended.
        this.#playing(player, event.timeStamp);
        this.#ended();
      });
    }
    setInterval(() => this.#keepTogether(), COMPARE_MS);
    document.addEventListener("visibilitychange", () => this.#comeBack());
  }

  /** Whether both have begun to play. */
  get hasPlayed() {
    return this.#hasPlayed;
  }

  get players() {
    return [this.left, this.right];
  }

  get videos() {
    return [this.left.video, this.right.video];
  }

  /** Whether both videos are here to their ends. */
  get isWhole() {
    return this.left.isWhole && this.right.isWhole;
  }

  /**
   * @param {string} leftUrl
   * @param {string} rightUrl
   */
  show(leftUrl, rightUrl) {
    this.#turn += 1;
    clearTimeout(this.#rest);
    this.phase = "loading";
    this.worstDrift = 0;
    this.#pressed = false;
    this.#hasPlayed = false;
    this.#playingAt.clear();
    this.left.show(leftUrl);
    this.right.show(rightUrl);
  }

  /** Play both from their beginning because somebody pressed for it. */
  press() {
    this.#pressed = true;
    if (this.phase === "press" || this.players.every((player) => player.isReady)) {
      this.#start();
    }
  }

  #ready() {
    if (!this.players.every((player) => player.isReady)) {
      return;
    }
    if (this.phase === "held") {
      this.#goOn();
    } else if (this.phase === "loading" || this.phase === "press") {
      if (wantsLessMotion() && !this.#pressed) {
        this.#needPress();
      } else {
        this.#start();
      }
    }
  }

  /** @param {"held" | "loading"} phase */
  #hold(phase) {
    if (phase === "loading" || this.phase === "playing") {
      if (this.phase === "press") {
        this.listener.onNoPressNeeded(); // it would not help now
      }
      this.#turn += 1;
      clearTimeout(this.#rest);
      this.phase = phase;
      this.videos.forEach((video) => video.pause());
    }
  }

  #needPress() {
    if (this.phase === "loading" && this.players.every((player) => player.state !== "failed")) {
      this.phase = "press";
      this.listener.onNeedsPress();
    }
  }

  /** Both from the first frame. In the very task of a press when nothing has to be wound back, for browsers that insist. */
  #start() {
    const turn = (this.#turn += 1);
    clearTimeout(this.#rest);
    this.phase = "playing";
    this.#playingAt.clear();
    this.listener.onNoPressNeeded();
    const late = this.videos.filter((video) => video.currentTime > 0 || video.seeking);
    if (late.length === 0) {
      this.#play(this.videos, turn);
      return;
    }
    this.videos.forEach((video) => video.pause());
    Promise.all(late.map((video) => moved(video, 0))).then(() => turn === this.#turn && this.#play(this.videos, turn));
  }

  /** After a stall: from where the one that waited stands. A shorter one that has come to its end stays there. */
  #goOn() {
    const turn = (this.#turn += 1);
    this.phase = "playing";
    const left = this.players.filter((player) => !(player.video.ended && this.#hasBegun(player))).map(({ video }) => video);
    const behind = Math.min(...left.map((video) => video.currentTime));
    const ahead = left.filter((video) => video.currentTime - behind > TOLERATED_S);
    Promise.all(ahead.map((video) => moved(video, behind))).then(() => turn === this.#turn && this.#play(left, turn));
  }

  /** @param {Player} player */
  #hasBegun(player) {
    return this.#hasPlayed || this.#playingAt.has(player.side);
  }

  /**
   * @param {HTMLVideoElement[]} videos
   * @param {number} turn
   */
  #play(videos, turn) {
    if (!this.#hasPlayed) {
      attempt(() => this.#measureStart(turn));
    }
    const playing = videos.map((video) => {
      video.playbackRate = 1;
      return video.play();
    });
    Promise.all(playing).catch((error) => {
      if (turn !== this.#turn) {
        return; // overtaken by another pair or another start
      }
      if (error.name === "NotAllowedError") {
        this.videos.forEach((video) => video.pause());
        this.phase = "loading";
        this.#needPress();
      }
      // A video that cannot play is the player's matter, which shows a message and retries; one that something else
      // paused before it began goes on by `#resumeHalted`; and one of a single frame has ended before it played.
    });
  }

  /**
   * @param {Player} player
   * @param {number} at milliseconds on the page's clock
   */
  #playing(player, at) {
    if (this.#hasPlayed || this.phase !== "playing") {
      return;
    }
    this.#playingAt.set(player.side, at);
    this.listener.onEvent("playing", player.side);
    if (this.#playingAt.size === 2) {
      this.#hasPlayed = true;
      this.listener.onFirstPlaying(Math.max(...this.#playingAt.values()));
    }
  }

  #ended() {
    if (this.phase !== "playing" || !this.#hasPlayed || !this.videos.every((video) => video.ended)) {
      return;
    }
    this.phase = "resting";
    this.listener.onEvent("ended", null);
    this.listener.onSeen();
    if (!wantsLessMotion()) {
      this.#rest = setTimeout(() => this.#start(), REST_MS);
    }
  }

  /** A video that something else paused (an extension, the system): both go on from where the one behind stands. */
  #resumeHalted() {
    const isHalted =
      this.phase === "playing" &&
      document.visibilityState !== "hidden" &&
      this.videos.some((video) => video.paused && !video.ended) &&
      this.videos.every((video) => !video.seeking);
    this.#halted = isHalted ? this.#halted + 1 : 0;
    if (this.#halted === MOST_HALTED) {
      this.#halted = 0;
      this.listener.onEvent("halted", null);
      this.#goOn();
    }
  }

  #keepTogether() {
    this.#resumeHalted();
    const [left, right] = this.videos;
    const running = this.videos.every((video) => !video.paused && !video.ended && !video.seeking && video.readyState >= 3);
    if (this.phase !== "playing" || !running) {
      return;
    }
    const apart = left.currentTime - right.currentTime;
    this.worstDrift = Math.max(this.worstDrift, Math.abs(apart) * 1000);
    if (Math.abs(apart) > JUMP_S) {
      right.currentTime = left.currentTime;
      right.playbackRate = 1;
    } else {
      const change = Math.abs(apart) > TOLERATED_S ? apart / (2 * COMPARE_MS / 1000) : 0;
      right.playbackRate = 1 + Math.max(-RATE_CHANGE, Math.min(RATE_CHANGE, change));
    }
  }

  /** Browsers pause silent videos of hidden tabs, and not all of them play on by themselves. */
  #comeBack() {
    if (document.visibilityState === "visible" && this.phase === "playing" && this.videos.some((video) => video.paused && !video.ended)) {
      this.#goOn();
    }
  }

  /**
   * How far apart the two first moving frames were, from when each was put on the screen and where it belongs in its video.
   * @param {number} turn
   */
  #measureStart(turn) {
    /** @type {number[]} */
    const offsets = [];
    for (const video of this.videos) {
      if (!("requestVideoFrameCallback" in video)) {
        return;
      }
      /** @type {VideoFrameRequestCallback} */
      const look = (_now, frame) => {
        if (turn !== this.#turn) {
          return;
        }
        if (frame.mediaTime === 0) {
          video.requestVideoFrameCallback(look);
          return;
        }
        offsets.push((video === this.left.video ? 1 : -1) * (frame.expectedDisplayTime - frame.mediaTime * 1000));
        if (offsets.length === 2) {
          this.listener.onEvent("start_skew", null, Math.round(Math.abs(offsets[0] + offsets[1])));
        }
      };
      video.requestVideoFrameCallback(look);
    }
  }
}

/**
 * @param {HTMLVideoElement} video
 * @param {number} seconds
 * @returns {Promise<void>} when it stands there
 */
function moved(video, seconds) {
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, SEEK_MS);
    video.addEventListener("seeked", () => { clearTimeout(timer); resolve(); }, { once: true });
    video.currentTime = seconds;
  });
}
