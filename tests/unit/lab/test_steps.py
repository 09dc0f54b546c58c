"""The tidy table of steps."""

from __future__ import annotations

from dataclasses import replace

import pytest

from app.lab.environments import World
from app.lab.experiments import Task
from app.lab.steps import COLUMNS, StepTableError, from_csv, to_csv
from app.lab.trials import run_trial

TASK = Task("uncertain", (12, 13), "env1", "uncertain", "knockout", 3, 99, 4)


@pytest.mark.parametrize(("evaluator", "method"), [("uncertain", "knockout"), ("score", "bo")])
def test_a_table_gives_back_the_very_steps_it_was_written_from(
    world: World, evaluator: str, method: str
) -> None:
    steps = run_trial(replace(TASK, evaluator=evaluator, method=method), world)
    assert from_csv(to_csv(steps)) == steps


def test_the_table_is_tidy_one_header_and_a_row_per_step(world: World) -> None:
    lines = to_csv(run_trial(TASK, world)).splitlines()
    assert lines[0].split(",") == list(COLUMNS)
    assert len(lines) == 1 + 4
    assert all(column == column.lower() for column in COLUMNS)


def test_another_table_is_refused_by_its_columns() -> None:
    with pytest.raises(StepTableError, match="expected the columns experiment"):
        from_csv("a,b\n1,2\n")


def test_a_row_cut_short_is_named(world: World) -> None:
    text = to_csv(run_trial(TASK, world))
    with pytest.raises(StepTableError, match="line 5: expected 27 cells"):
        from_csv(text[: text.rstrip().rindex(",") - 20])


def test_a_cell_of_another_kind_is_named(world: World) -> None:
    text = to_csv(run_trial(TASK, world)).replace(",99,0,", ",99,zero,", 1)
    with pytest.raises(StepTableError, match="line 2: query_index: expected int, got 'zero'"):
        from_csv(text)
