import assert from "node:assert/strict";
import { test } from "node:test";

import { isLong, pollSeconds } from "../../static/js/waiting_times.js";

test("a machine that takes 20 seconds is late after a minute, and not before", () => {
  assert.equal(isLong(59, 20, 1), false);
  assert.equal(isLong(61, 20, 1), true);
});

test("a quick machine is not called late within 45 seconds", () => {
  assert.equal(isLong(44, 1, 1), false);
  assert.equal(isLong(46, 1, 1), true);
});

test("without a machine the way out is shown after 20 seconds", () => {
  assert.equal(isLong(21, 600, 0), true);
  assert.equal(isLong(21, 600, 1), false);
});

test("the first recordings, whose duration nobody knows, are not late before two minutes", () => {
  assert.equal(isLong(120, null, 1), false);
  assert.equal(isLong(140, null, 1), true);
});

test("the server is asked each second at first, and each ten after five minutes", () => {
  assert.deepEqual([0, 29, 30, 299, 300].map(pollSeconds), [1, 1, 3, 3, 10]);
});
