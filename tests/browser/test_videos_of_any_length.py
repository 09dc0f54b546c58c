"""Videos of one frame, of unequal lengths, or paused from outside: the pair never freezes."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from .evaluator import answer
from .server import Server
from .small_study import SMALL_PLAN
from .test_videos_that_do_not_play import stored

#: Only a pair that was seen to both ends can be answered.
WATCH_PLAN = SMALL_PLAN + "query: {watch_once: true}\n"

#: Counts how often each video has ended, and runs `disturb` at each event of one.
WATCHED = """(() => {
    window.ends = { left: 0, right: 0 };
    const side = ({ target }) => target.dataset?.testid?.replace("video-", "");
    const disturb = %s;
    for (const event of ["play", "playing", "timeupdate", "ended"]) {
        document.addEventListener(event, (happened) => {
            const of = side(happened);
            if (of === "left" || of === "right") {
                const other = document.querySelector(
                    `[data-testid="video-${of === "left" ? "right" : "left"}"]`);
                window.ends[of] += event === "ended" ? 1 : 0;
                disturb(event, happened.target, other);
            }
        }, true);
    }
})()"""

NOTHING = "() => {}"
#: A power saving mode that takes a video back as soon as it starts, before its first frame.
AT_THE_START = """(event, video) => {
    if (event === "play" && !window.taken) {
        window.taken = true;
        video.pause();
    }
}"""
#: A media key: both are paused in the middle.
BY_A_KEY = """(event, video, other) => {
    if (event === "timeupdate" && video.currentTime > 0.4 && !video.ended && !window.taken) {
        window.taken = true;
        video.pause();
        other.pause();
    }
}"""
#: The longer one is paused while the shorter one stands at its end, and how far it was goes on.
AFTER_THE_SHORTER = """(event, video, other) => {
    if (event === "timeupdate" && other.ended && !video.ended && !window.taken) {
        window.taken = true;
        window.pausedAt = video.currentTime;
        video.pause();
    } else if (event === "playing" && window.taken && window.playsOnAt === undefined) {
        window.playsOnAt = video.currentTime;
        window.otherHasEnded = other.ended;
    }
}"""


def begin(page: Page, server: Server, disturb: str = NOTHING) -> None:
    page.add_init_script(WATCHED % disturb)
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()


@pytest.mark.parametrize("form", ["mp4", "webm"])
@pytest.mark.parametrize("frames", [(1,), (1, 12), (4, 25)], ids=["one", "one and many", "unequal"])
def test_a_pair_of_any_lengths_is_seen_and_answered(
    page: Page, serve: Callable[..., Server], frames: tuple[int, ...], form: str
) -> None:
    server = serve(WATCH_PLAN, frames=frames, form=form)
    begin(page, server)
    for number in range(1, 4):
        expect(page.get_by_test_id("progress")).to_contain_text(f"Pair {number} of 4")
        expect(page.get_by_test_id("answer-left")).to_be_enabled()
        answer(page, ("left", "right")[number % 2], by="key")
    # They go on playing: the next pair begins anew, both of it.
    page.wait_for_function("() => window.ends.left >= 5 && window.ends.right >= 5")
    queries, responses, _ = stored(server)
    assert responses == ["right", "left", "right"]
    assert [fault for _, fault in queries if fault] == []


@pytest.mark.parametrize("disturb", [AT_THE_START, BY_A_KEY], ids=["at the start", "by a key"])
def test_a_pair_that_something_else_pauses_goes_on(
    page: Page, serve: Callable[..., Server], disturb: str
) -> None:
    server = serve(WATCH_PLAN)
    begin(page, server, disturb)
    page.wait_for_function("() => window.taken")
    expect(page.get_by_test_id("answer-left")).to_be_enabled()
    answer(page, "left", by="key")
    assert stored(server)[1] == ["left"]


def test_a_longer_video_that_is_paused_goes_on_from_where_it_stood(
    page: Page, serve: Callable[..., Server]
) -> None:
    server = serve(WATCH_PLAN, frames=(5, 30))
    begin(page, server, AFTER_THE_SHORTER)
    # Pairs of two equal ones are answered until one comes with a longer and a shorter one.
    for _ in range(4):
        expect(page.get_by_test_id("answer-left")).to_be_enabled()
        if page.evaluate("() => window.playsOnAt !== undefined"):
            break
        answer(page, "left", by="key")
    said = page.evaluate("() => [window.pausedAt, window.playsOnAt, window.otherHasEnded]")
    assert said[1] >= said[0] - 0.1, said
    assert said[2], "the shorter one began again in the middle of the longer one"
