import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { newPage } from "./page.mjs";
import { Refused } from "../../static/js/api.js";
import { Outbox } from "../../static/js/outbox.js";
import { Unreachable } from "../../static/js/request.js";

const ANSWER = { query_id: "q1", response: "left" };

/** An API that answers each attempt with the next of these: errors are thrown. */
function apiOf(...answers) {
  const sent = [];
  return {
    slug: "crane",
    sent,
    async respond(answer) {
      sent.push(answer);
      const next = answers.shift();
      if (next instanceof Error) {
        throw next;
      }
      return next;
    },
  };
}

function listener() {
  const told = [];
  return { told, onLate: () => told.push("late"), onSaved: () => told.push("saved") };
}

beforeEach(newPage);

test("an answer that the server takes at once is kept no longer", async () => {
  const told = listener();
  const outbox = new Outbox(apiOf({ stage: "query" }), told);
  assert.deepEqual(await outbox.send(ANSWER), { stage: "query" });
  assert.equal(outbox.unsaved("q1"), null);
  assert.deepEqual(told.told, []);
});

test("an answer is kept over a reload while the line is broken", async () => {
  const never = { slug: "crane", respond: () => new Promise(() => {}) };
  new Outbox(never, listener()).send(ANSWER);
  const afterReload = new Outbox(never, listener());
  assert.deepEqual(afterReload.unsaved("q1"), ANSWER);
  assert.equal(afterReload.unsaved("q2"), null);
});

test("a broken line and a busy server are tried again until the answer is saved", async () => {
  const api = apiOf(new Unreachable("away"), new Refused(503, {}), { stage: "query" });
  const told = listener();
  const outbox = new Outbox(api, told);
  const saved = outbox.send(ANSWER);
  const hurry = setInterval(() => outbox.tryNow(), 5);
  await saved;
  clearInterval(hurry);
  assert.equal(api.sent.length, 3);
  assert.deepEqual(told.told, ["late", "late", "saved"]);
});

test("a line that comes back is tried at once", async () => {
  const api = apiOf(new Unreachable("away"), { stage: "query" });
  const saved = new Outbox(api, listener()).send(ANSWER);
  const hurry = setInterval(() => window.dispatchEvent(new Event("online")), 5);
  await saved;
  clearInterval(hurry);
  assert.equal(api.sent.length, 2);
});

for (const refusal of [new Refused(409, {}), new TypeError("a mistake of ours")]) {
  test(`${refusal.name} is not taken for a broken line`, async () => {
    const api = apiOf(refusal);
    const told = listener();
    const outbox = new Outbox(api, told);
    await assert.rejects(outbox.send(ANSWER), refusal);
    assert.equal(api.sent.length, 1);
    assert.deepEqual(told.told, []);
    assert.equal(outbox.unsaved("q1"), null);
  });
}
