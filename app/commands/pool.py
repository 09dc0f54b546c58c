"""`pbpo pool`: all people of a study judged together, a condition at a time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from app.services import export as exports
from app.services.accounts.audit_log import COMMAND_LINE
from app.services.export import TABLES
from app.services.export.table import Request, trials_of
from app.services.pooling.people import PooledPeople, judged_together
from app.services.results import people
from app.services.results.trial_posterior import percent

from .export import Overwrite
from .filters import Filters, with_filters
from .options import DataDir, Slug, app_context_of, out


@with_filters
def pool(
    slug: Slug,
    filters: Filters,
    out_dir: Annotated[
        Path | None,
        typer.Option("--out", help="A folder for people.csv and population.csv."),
    ] = None,
    overwrite: Overwrite = False,
    data_dir: DataDir = None,
) -> None:
    """Judge everybody's answers together: what people like, who differs, who is reliable."""
    app = app_context_of(data_dir)
    request = filters.request(app, slug)
    for named in request.study.plan.conditions:
        if request.conditions and named.name not in request.conditions:
            continue
        with app.database.read() as db:
            found = judged_together(
                db, request.people, request.study, named.name, request.modes, *trials_of(request)
            )
        _say(found, request)
    if out_dir is not None:
        files = [exports.table_file(TABLES[name], request) for name in ("people", "population")]
        for path in exports.write_folder(
            app, COMMAND_LINE, request, "csv", files, out_dir, overwrite=overwrite
        ):
            out.print(str(path))


def _say(found: PooledPeople, request: Request) -> None:
    out.print(f"{found.condition}:", style="bold")
    summary, plan = found.summary, request.study.plan
    if summary is None:
        out.print(f"{found.why_not}\n")
        return
    for sentence in people.sentences(found, summary, plan):
        out.print(sentence)
    table = Table(box=box.SIMPLE)
    for name in ("person", "answers", "noise", "likeness", "costs", "influence", "own best"):
        right = name not in ("person", "own best")
        table.add_column(name, justify="right" if right else "left", no_wrap=name == "person")
    for person in found.people:
        one = person.summary
        table.add_row(
            one.name,
            str(one.answers),
            f"{one.noise.value:.1f}",
            f"{one.likeness:.2f}",
            percent(one.costs),
            f"{one.influence:.2f}",
            ", ".join(
                f"{parameter.name} {value:g}"
                for parameter, value in zip(
                    plan.parameters, summary.points[one.best].tolist(), strict=True
                )
            ),
        )
    out.print(table)
    for person in found.people:
        for reason in person.reasons:
            out.print(f"{person.name}: {reason}")
    out.print("")
