"""Texts become safe HTML, and a consent text has a version."""

import pytest

from app.study import consent_version, render
from app.study.placeholders import placeholders


def test_headings_begin_below_the_page_title() -> None:
    html = render("# One\n\n## Two\n\n###### Six\n")
    assert html == "<h2>One</h2>\n<h3>Two</h3>\n<h6>Six</h6>\n"


def test_ordinary_markdown_is_rendered() -> None:
    html = render(
        "A *word* and **two**.\n\n1. one\n2. two\n\n| key | does |\n|---|---|\n| a | b |\n"
    )
    for expected in ("<em>word</em>", "<strong>two</strong>", "<ol>", "<table>", "<td>b</td>"):
        assert expected in html


@pytest.mark.parametrize(
    "markdown",
    [
        "<script>alert(1)</script>",
        "words <img src=x onerror=alert(1)> words",
        "<div onclick='x()'>\n\nwords\n\n</div>",
        "![a picture](https://example.org/x.png)",
    ],
)
def test_raw_html_and_pictures_never_reach_the_page(markdown: str) -> None:
    html = render(markdown)
    for forbidden in ("<script", "<img", "<div"):
        assert forbidden not in html


@pytest.mark.parametrize("address", ["javascript:alert(1)", "data:text/html,x", "vbscript:x"])
def test_an_address_that_would_run_is_no_link(address: str) -> None:
    assert "<a " not in render(f"[press]({address})")


def test_a_link_opens_beside_the_study_and_tells_nothing_about_it() -> None:
    html = render("[page](https://example.org)")
    assert html == (
        '<p><a href="https://example.org" target="_blank" rel="noopener noreferrer">page</a></p>\n'
    )


def test_a_version_is_twelve_hex_digits_of_a_known_hash() -> None:
    # printf 'Agree?' | sha256sum
    assert consent_version("Agree?") == "f92ed29dae8a"


@pytest.mark.parametrize("same", ["Agree?\n", "\nAgree?  ", "Agree?\r\n", "Agree?\n\n"], ids=repr)
def test_what_no_reader_sees_keeps_the_version(same: str) -> None:
    assert consent_version(same) == consent_version("Agree?")


def test_the_encoding_of_an_accent_keeps_the_version() -> None:
    assert consent_version("caf\u00e9") == consent_version("cafe\u0301")


@pytest.mark.parametrize("other", ["Agree!", "agree?", "Agree ?", "Agree?\n\nx"], ids=repr)
def test_any_other_word_or_sign_changes_the_version(other: str) -> None:
    assert consent_version(other) != consent_version("Agree?")


def test_a_placeholder_is_found_and_a_link_is_none() -> None:
    text = "Run by [your names and institution].\n\nSee [the lab](https://lab.example), ![x](y).\n"
    assert placeholders(text) == [(1, "[your names and institution]")]


@pytest.mark.parametrize("text", ["as in [1]", "[Art. 13] holds", "- [ ] done", "[left]", r"\[1\]"])
def test_other_words_in_brackets_are_text(text: str) -> None:
    assert placeholders(text) == []
