"""What an evaluator does in the browser, in few words."""

from __future__ import annotations

from playwright.sync_api import Page, expect

#: A pair may have to be rendered first, on a busy machine.
FIRST_FRAME_MS = 120_000

BOTH_PLAY = """() => {
    const button = document.querySelector('[data-testid="answer-left"]');
    if (!button || button.getAttribute("aria-disabled") === "true") {
        return false;
    }
    const videos = ["video-left", "video-right"].map(
        (name) => document.querySelector(`[data-testid="${name}"]`));
    return videos.every((video) => video && !video.paused && video.currentTime > 0.2
        && video.getVideoPlaybackQuality().totalVideoFrames > 2);
}"""

KEYS = {"left": "ArrowLeft", "right": "ArrowRight", "skip": "ArrowDown"}
BUTTONS = {"left": "answer-left", "right": "answer-right", "skip": "skip"}


def enter(page: Page, url: str) -> None:
    """From the link to the first pair."""
    page.goto(url)
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()
    expect(page.get_by_text("Video 1 of 2")).to_be_visible()
    page.get_by_test_id("continue").click()
    watch(page)


def enter_small(page: Page, url: str) -> None:
    """From the link to the first pair of a study of small videos."""
    page.goto(url)
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()
    watch(page)


def watch(page: Page) -> None:
    """Both videos play, and the pair can be answered."""
    # Looked for at every frame: expectations look once a second, and pairs go on meanwhile.
    page.wait_for_function(BOTH_PLAY, timeout=FIRST_FRAME_MS)


def query_on_screen(page: Page) -> str:
    """Which pair is shown: where the session is, in words."""
    return page.get_by_test_id("progress").inner_text()


def answer(page: Page, response: str, *, by: str) -> None:
    """Press, and wait until the page shows something else."""
    before = query_on_screen(page)
    if by == "key":
        page.keyboard.press(KEYS[response])
    else:
        page.get_by_test_id(BUTTONS[response]).click()
    page.wait_for_function(
        """(before) => {
            const line = document.querySelector('[data-testid="progress"]');
            return !line || line.textContent.trim() !== before.trim();
        }""",
        arg=before,
    )


def may_skip(page: Page) -> bool:
    return page.get_by_test_id("skip").count() == 1
