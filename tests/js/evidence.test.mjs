import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { newPage } from "./page.mjs";
import { EvidenceLog } from "../../static/js/evidence.js";

/** The server keeps no more events of one call. */
const KEPT_BY_THE_SERVER = 60;

function pairOf(...played) {
  const players = played.map((ranges, index) => ({
    side: index ? "right" : "left",
    state: "playing",
    video: {
      duration: 10,
      clientWidth: 640,
      played: { length: ranges.length, start: (at) => ranges[at][0], end: (at) => ranges[at][1] },
    },
  }));
  return { players, worstDrift: 3.4 };
}

const WATCHED = pairOf([[0, 4], [6, 9]], [[0, 10]]);
const of = (answer, name) => answer.events.filter(({ event }) => event === name);

beforeEach(newPage);

test("the reaction time counts from when both videos played", () => {
  const log = new EvidenceLog();
  log.begin();
  log.bothPlaying(1000);
  assert.equal(log.answer("q1", "left", 3500.4, WATCHED).rt_ms, 2500);
  assert.equal(log.answer("q1", "left", 900, WATCHED).rt_ms, 0);
});

test("the watched part of each video is the part that was played at least once", () => {
  const log = new EvidenceLog();
  log.begin();
  const answer = log.answer("q1", "left", 0, WATCHED);
  assert.deepEqual(of(answer, "watched").map(({ side, value }) => [side, value]), [["left", 0.7], ["right", 1]]);
});

test("a long record leaves out the middle, says how much, and keeps what is told at the end", () => {
  const log = new EvidenceLog();
  log.begin();
  for (let index = 0; index < 500; index += 1) {
    log.add("replay");
  }
  const answer = log.answer("q1", "skip", 0, WATCHED);
  assert.ok(answer.events.length <= KEPT_BY_THE_SERVER);
  assert.equal(answer.events.filter(({ event }) => event === "replay").length + answer.events_left_out, 500);
  assert.equal(of(answer, "worst_drift").length, 1);
});

test("a new pair begins a new record", () => {
  const log = new EvidenceLog();
  log.begin();
  log.replays = 2;
  window.dispatchEvent(new Event("blur"));
  log.begin();
  const answer = log.answer("q2", "left", 0, WATCHED);
  assert.equal(answer.replays, 0);
  assert.equal(of(answer, "blur").length, 0);
});

test("a fault says how it was noticed and what each player was doing", () => {
  const log = new EvidenceLog();
  log.begin();
  assert.equal(log.fault("q1", "pressed", WATCHED).reason, "pressed; left: playing; right: playing");
});
