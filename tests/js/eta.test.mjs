import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { newPage } from "./page.mjs";
import { Eta } from "../../static/js/eta.js";

const FIRST = { trial: 1, trials: 3, query: 1, queries: 30 };

beforeEach(newPage);

test("before there is anything to go by, a comparison counts 14 seconds", () => {
  assert.equal(new Eta("crane").left(FIRST, 60), "About 23 min left"); // 90 x 14 s and two breaks
});

test("the median of the last nine counts, so that one pause does not matter", () => {
  const eta = new Eta("crane");
  for (const seconds of [6, 6, 3600, 6, 6]) {
    eta.took(seconds);
  }
  assert.equal(eta.left(FIRST, 0), "About 9 min left");
});

test("what comes to less than half a minute is said to be less than one", () => {
  assert.equal(new Eta("crane").left({ trial: 3, trials: 3, query: 30, queries: 30 }, 60), "Less than a minute left");
});

test("a reload remembers how long comparisons took, and another study does not", () => {
  const eta = new Eta("crane");
  [30, 30, 30].forEach((seconds) => eta.took(seconds));
  assert.equal(new Eta("crane").left(FIRST, 0), "About 45 min left");
  assert.equal(new Eta("straw").left(FIRST, 0), "About 21 min left");
});

test("a storage that throws costs no more than the memory of it", () => {
  const broken = { getItem() { throw new Error("blocked"); }, setItem() { throw new Error("blocked"); } };
  globalThis.sessionStorage = window.sessionStorage = broken;
  const eta = new Eta("crane");
  [30, 30, 30].forEach((seconds) => eta.took(seconds));
  assert.equal(eta.left(FIRST, 0), "About 45 min left");
});
