"""Figures: what a chart shows of its table, and that it can be drawn."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from app.figures import (
    FigureDataError,
    Row,
    bands,
    boxes,
    counts,
    in_the_dark,
    intervals,
    maps,
    mean_curves,
    paths,
    save,
    scatters,
    side,
    slices,
    strips,
    violins,
)
from app.figures.curves import BAND_STANDARD_ERRORS
from app.figures.theme import COLOURS, INK, LABELS, PAPER, colour_scale
from app.figures.violins import HALF_WIDTH, outline

METHODS = ("pbpo", "knockout")
CURVES: list[Row] = [
    {"panel": panel, "method": method, "query": query, "value": -100.0 + query + 2 * trial}
    for panel in ("Env1", "Env2")
    for method in METHODS
    for trial in range(3)
    for query in (1, 2)
]
#: Each value three times: fewer than eight trials are no violin.
VIOLINS: list[Row] = [{**row, "group": row["query"]} for row in CURVES for _ in range(3)]
MAP: list[Row] = [
    {"panel": "f", "w0": 0.05 * i, "w1": 0.05 * j, "value": float(i - j)}
    for i in range(4)
    for j in range(i + 1)
]
COUNTS: list[Row] = [
    {"panel": "Env1", "person": person, "count": count}
    for person, of_person in (("1", (0, 3)), ("2", (20, 30)))
    for count in of_person
]
SHARES: list[Row] = [
    {"panel": "all", "name": name, "value": 0.5, "low": 0.4, "high": 0.6, "number": 20}
    for name in ("a", "b")
]
ALONG: list[Row] = [
    {"panel": "speed (m/s)", "group": "pbpo", "query": query, "value": 0.1 * query}
    for query in (1, 2, 3)
]
SLICE: list[Row] = [{**row, "mean": row["value"], "low": -1.0, "high": 1.0} for row in ALONG]
FIGURES: dict[str, Callable[[], Any]] = {
    "curves": lambda: mean_curves(CURVES, methods=METHODS, optimum={"Env1": -40.0}),
    "violins": lambda: violins(VIOLINS, methods=METHODS, optimum={"Env1": -40.0}),
    "boxes": lambda: boxes(CURVES, methods=METHODS, optimum={"Env1": -40.0}),
    "maps": lambda: maps(MAP, points=MAP[:2], optimum=MAP[:1]),
    "counts": lambda: counts(COUNTS),
    "intervals": lambda: intervals(SHARES, x_title="share", y_title="who", reference=0.5),
    "bands": lambda: bands(CURVES, methods=METHODS, y_title="seconds"),
    "strips": lambda: strips(ALONG),
    "slices": lambda: slices(SLICE, points=ALONG[:1], optimum=ALONG[2:]),
    "paths": lambda: paths(ALONG),
}


def values(chart: Any) -> list[dict[str, Any]]:
    """Every row that a chart carries; equal tables are carried once."""
    tables = chart.to_dict()["datasets"].values()
    return [row for table in tables for row in json.loads(table)]


@pytest.mark.parametrize("name", FIGURES)
def test_one_definition_gives_page_svg_and_png(name: str, tmp_path: Path) -> None:
    chart = FIGURES[name]()
    assert chart.to_dict()["$schema"].endswith(".json")
    svg, png = save(chart, tmp_path / "figures", name)
    assert ElementTree.parse(svg).getroot().tag.endswith("svg")
    with Image.open(png) as image:
        assert min(image.size) > 200
    assert sorted(path.name for path in svg.parent.iterdir()) == [f"{name}.png", f"{name}.svg"]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_the_same_each_time(name: str) -> None:
    assert FIGURES[name]().to_dict() == FIGURES[name]().to_dict()


def test_a_curve_is_the_mean_over_trials_with_its_interval() -> None:
    rows = [row for row in values(FIGURES["curves"]()) if row.get("query") == 2]
    error = 2.0 / np.sqrt(3)
    for row in rows:
        assert row["mean"] == -96.0
        assert row["high"] - row["mean"] == pytest.approx(BAND_STANDARD_ERRORS * error, abs=1e-3)
        assert row["trials"] == 3
    assert {row["method"] for row in rows} == {LABELS[method] for method in METHODS}


def test_a_violin_has_its_median_and_quartiles() -> None:
    bars = [row for row in values(FIGURES["violins"]()) if "median" in row]
    assert len(bars) == 2 * 2  # both panels show the same here
    assert {(row["low"], row["median"], row["high"]) for row in bars} == {
        (-99.0, -97.0, -95.0),
        (-98.0, -96.0, -94.0),
    }


def test_fewer_than_eight_trials_are_dots_and_no_violin() -> None:
    few = [row for row in VIOLINS if row["method"] == METHODS[0]][:7]
    chart = violins(few, methods=METHODS)
    drawn = values(chart)
    assert sorted(row["value"] for row in drawn if "value" in row) == sorted(
        row["value"] for row in few
    )
    assert not [row for row in drawn if "left" in row or "median" in row]
    assert "area" not in str(chart.to_dict())


def test_stars_stand_above_everything_and_only_where_there_are_some() -> None:
    stars = [
        {"panel": "Env1", "group": group, "first": "pbpo", "second": "knockout", "stars": text}
        for group, text in ((1, "**"), (2, ""))
    ]
    chart = violins(VIOLINS, methods=METHODS, stars=stars, optimum={"Env1": -40.0})
    marks = [row for row in values(chart) if "stars" in row]
    assert {row["stars"] for row in marks} == {"**"}
    assert all(row["y"] > -40.0 for row in marks)


def test_an_outline_ends_where_the_values_do_and_is_widest_where_most_are() -> None:
    shape = outline([0.0, 10.0, 10.0, 10.2, 9.9], bandwidth_floor=0.1)
    heights, widths = zip(*shape, strict=True)
    assert (heights[0], heights[-1]) == (0.0, 10.2)
    assert max(widths) == pytest.approx(HALF_WIDTH)
    assert heights[int(np.argmax(widths))] == pytest.approx(10.0, abs=0.8)


def test_values_that_are_all_alike_are_still_drawn() -> None:
    heights = [height for height, _ in outline([5.0] * 4, bandwidth_floor=0.2)]
    assert (min(heights), max(heights)) == pytest.approx((4.9, 5.1))
    same = [{**row, "value": -46.2} for row in VIOLINS]
    assert values(violins(same, methods=METHODS))


def test_a_square_of_a_map_surrounds_its_candidate() -> None:
    squares = [row for row in values(FIGURES["maps"]()) if "value" in row]
    assert len(squares) == len(MAP)
    assert squares[1]["x"] == pytest.approx(0.025)
    assert squares[1]["right"] >= 0.075


def test_a_study_of_its_own_is_mapped_by_its_own_steps() -> None:
    across = side("speed", "speed (m/s)", [0.1, 0.2, 0.6])
    assert across.square(0.1) == pytest.approx((0.05, 0.15))
    assert across.square(0.2) == pytest.approx((0.15, 0.4))
    assert across.domain == pytest.approx([0.05, 0.8])
    one = side("height", "height", [3.0])
    rows = [{"panel": "f", "speed": s, "height": 3.0, "value": s} for s in (0.1, 0.2, 0.6)]
    drawn = values(maps(rows, sides=(across, one), optimum=rows[2:]))
    assert [row["x"] for row in drawn if "value" in row] == pytest.approx([0.05, 0.15, 0.4])


def test_so_many_values_are_no_grid_and_each_candidate_keeps_a_square_of_its_own() -> None:
    across = side("speed", "speed", [index / 100 for index in range(101)])
    low, high = across.square(0.5)
    assert (high - low) == pytest.approx(0.024)


def test_a_band_goes_from_quartile_to_quartile() -> None:
    table = [{"panel": "p", "method": "pbpo", "query": 1, "value": v} for v in (1, 2, 3, 4, 5)]
    [row] = values(bands(table, methods=["pbpo"], y_title="s"))
    assert (row["low"], row["median"], row["high"], row["answers"]) == (2, 3, 4, 5)


def test_many_people_share_the_width_and_go_unnamed() -> None:
    many = [{"panel": "p", "person": str(n), "count": n % 5} for n in range(200)]
    panel = counts(many).to_dict()["hconcat"][0]
    assert panel["width"] == 420
    assert panel["layer"][0]["encoding"]["x"]["axis"]["labels"] is False


def test_in_the_dark_ink_and_paper_change_places_and_the_data_stay() -> None:
    light = json.dumps(FIGURES["maps"]().to_dict())
    dark = in_the_dark(light)
    assert f'"{INK}"' not in dark
    assert f'"{PAPER}"' not in dark
    assert json.loads(dark)["datasets"] == json.loads(light)["datasets"]


def test_points_on_one_place_become_one_with_their_count() -> None:
    place = {"panel": "f", "w0": 0.05, "w1": 0.0}
    chart = maps(MAP, points=[place, place, {**place, "w0": 0.1}])
    assert sorted(row["count"] for row in values(chart) if "count" in row) == [1, 2]


def test_maps_stand_in_rows_of_the_length_asked_for() -> None:
    rows = [{**row, "panel": panel} for panel in "abcde" for row in MAP]
    spec = maps(rows, columns=2).to_dict()
    assert [len(line["hconcat"]) for line in spec["vconcat"]] == [2, 2, 1]


def test_a_bar_of_counts_is_the_mean_of_its_dots() -> None:
    bars = [row for row in values(FIGURES["counts"]()) if isinstance(row["count"], float)]
    assert [(row["person"], row["count"]) for row in bars] == [("1", 1.5), ("2", 25.0)]


def test_methods_keep_their_colours_and_a_new_one_gets_another() -> None:
    scale = colour_scale(("pbpo", "pbpo-threshold")).to_dict()
    assert scale["domain"] == ["PBPO", "pbpo-threshold"]
    assert scale["range"][0] == COLOURS["pbpo"]
    assert scale["range"][1] not in COLOURS.values()


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda: mean_curves([], methods=METHODS), "mean curves: expected at least one row"),
        (lambda: counts([{"panel": "a", "person": "1"}]), "got row 0 without count"),
        (lambda: violins(CURVES, methods=METHODS), "without group"),
        (lambda: maps(MAP, columns=0), "columns from 1 on, got 0"),
        (lambda: maps(MAP, points=[{"panel": "f"}]), "maps, points: .* without w0, w1"),
    ],
)
def test_a_table_that_cannot_be_shown_is_named(draw: Callable[[], Any], message: str) -> None:
    with pytest.raises(FigureDataError, match=message):
        draw()


def test_people_on_two_axes_are_drawn_whole_and_marked_ones_apart() -> None:
    rows = [{"name": f"p{k}", "x": 0.0, "y": 1.0 + k, "marked": k == 2} for k in range(3)]
    chart = scatters(
        rows,
        x_title="costs",
        y_title="noise",
        marked_title="flagged",
        other_title="not",
        x_reference=0.25,
    )
    [panel] = chart.to_dict()["vconcat"]
    dots = panel["layer"][-1]
    low, high = dots["encoding"]["x"]["scale"]["domain"]
    assert low < 0.0
    assert high > 0.25
    assert [row["kind"] for row in values(chart) if "kind" in row] == ["not", "not", "flagged"]
