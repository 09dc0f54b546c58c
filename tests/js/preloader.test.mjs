import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { newPage } from "./page.mjs";
import { Preloader } from "../../static/js/preloader.js";

/** Requests of the page, answered by hand. */
function network() {
  const requests = [];
  globalThis.fetch = (url, { signal, cache } = {}) =>
    new Promise((resolve, reject) => {
      requests.push({ url, cache, answer: (status = 200) => resolve(new Response(status === 200 ? "video" : null, { status })) });
      signal?.addEventListener("abort", () => reject(signal.reason));
    });
  return requests;
}

const soon = () => new Promise((resolve) => setTimeout(resolve, 5));

beforeEach(newPage);

test("two videos at a time are fetched, the likeliest first", async () => {
  const requests = network();
  new Preloader().want(["/a", "/b", "/c"]);
  assert.deepEqual(requests.map(({ url }) => url), ["/a", "/b"]);
  requests[0].answer();
  await soon();
  assert.deepEqual(requests.map(({ url }) => url), ["/a", "/b", "/c"]);
});

test("a fetched video is played from memory, one that was not by its address", async () => {
  const requests = network();
  const preloader = new Preloader();
  preloader.want(["/a"]);
  const coming = preloader.source("/a");
  requests[0].answer();
  assert.match(await coming, /^blob:/);
  assert.match(preloader.source("/a"), /^blob:/);
  assert.equal(preloader.source("/b"), "/b");
});

for (const status of [404, 503]) {
  test(`a video answered by ${status} is left to the player`, async () => {
    const requests = network();
    const preloader = new Preloader();
    preloader.want(["/a"]);
    const coming = preloader.source("/a");
    requests[0].answer(status);
    assert.equal(await coming, "/a");
    assert.equal(preloader.isMissing("/a"), status === 404);
  });
}

test("what a response made pointless is fetched no further", async () => {
  const requests = network();
  const preloader = new Preloader();
  preloader.want(["/a", "/b", "/c"]);
  preloader.settle(["/a"]);
  requests[0].answer();
  await soon();
  assert.deepEqual(requests.map(({ url }) => url), ["/a", "/b"]);
  assert.match(preloader.source("/a"), /^blob:/);
  assert.equal(preloader.source("/b"), "/b");
});

test("videos of earlier pairs are let go, and those in use are not", async () => {
  const requests = network();
  const preloader = new Preloader();
  const urls = Array.from({ length: 20 }, (_, index) => `/${index}`);
  preloader.want(urls);
  for (let index = 0; index < urls.length; index += 1) {
    requests[index].answer();
    await soon();
  }
  preloader.settle(["/0"]);
  const kept = urls.filter((url) => preloader.source(url) !== url);
  assert.equal(kept.length, 12);
  assert.ok(kept.includes("/0"));
});
