"""Which sessions an export counts, what is kept of it, and the page where it is asked for."""

from __future__ import annotations

import hashlib
import html
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import httpx
import pandas as pd
import pypdfium2
import pytest
from scipy.stats import ttest_ind
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.services import export, reporting
from app.services.accounts import accounts, audit_log
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.export import File, Request
from app.services.export.provenance import EXPORTED, IDENTITIES, REPORTED
from app.services.monitoring.data_quality import Flag
from app.services.reporting.document import Figure, Table
from app.services.runtime.errors import ConflictError
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import SessionRow
from tests.conftest import Clock, StudyShelf
from tests.databases import Databases

from .client import Api, by_turns
from .conftest import EMAIL
from .desk import Desk
from .two_people import TwoPeople

FIRST_DAY, SECOND_DAY = date(2026, 3, 1), date(2026, 3, 2)
#: Tables with a row for each thing of a session, and what says which session and which trial.
OF_SESSIONS = ("sessions", "participants", "queries", "preferences", "acquired", "evidence")


@pytest.fixture(scope="module")
def people() -> TwoPeople:
    return TwoPeople()


@dataclass(frozen=True)
class Data:
    """The study of two people, as an experimenter's program and browser reach it."""

    app: AppContext
    study: StudyInfo
    client: Api
    api_token: str

    def get(self, path: str, **query: Any) -> httpx.Response:
        headers = {"Authorization": f"Bearer {self.api_token}"}
        return self.client.get(f"/api/v1/studies/short/{path}", params=query, headers=headers)

    def table(self, name: str, **query: Any) -> pd.DataFrame:
        answer = self.get(f"export/{name}.csv", **query)
        assert answer.status_code == 200, answer.text
        return pd.read_csv(io.BytesIO(answer.content))

    def trail(self, *actions: str) -> list[audit_log.AuditLine]:
        return audit_log.trail(self.app, "short", actions)


@pytest.fixture
def data(
    app: AppContext,
    client: Api,
    databases: Databases,
    study_shelf: StudyShelf,
    clock: Clock,
    people: TwoPeople,
) -> Data:
    study = people.put_into(app, client, databases, study_shelf, clock)
    return Data(app, study, client, people.api_token)


def same(one: pd.DataFrame, other: pd.DataFrame) -> None:
    pd.testing.assert_frame_equal(
        one.reset_index(drop=True), other.reset_index(drop=True), check_dtype=False
    )


@pytest.mark.parametrize("name", ["queries", "acquired", "preferences", "events", "evidence"])
def test_one_condition_is_what_pandas_would_choose(data: Data, name: str) -> None:
    queries = data.table("queries")
    condition = queries["condition"].iloc[0]
    trials = queries[queries["condition"] == condition]
    chosen = set(zip(trials["session_id"], trials["trial_index"], strict=True))
    everything = data.table(name)
    places = zip(everything["session_id"], everything["trial_index"], strict=True)
    expected = everything[[place in chosen for place in places]]
    assert 0 < len(expected) < len(everything)
    same(data.table(name, condition=condition), expected)


def test_two_conditions_are_both_and_sessions_are_those_that_had_one(data: Data) -> None:
    queries = data.table("queries")
    named = ["pbpo", "no-skip"]
    same(data.table("queries", condition=named), queries[queries["condition"].isin(named)])
    with_pbpo = set(queries.loc[queries["condition"] == "pbpo", "session_id"])
    sessions = data.table("sessions")
    same(
        data.table("sessions", condition="pbpo"),
        sessions[sessions["session_id"].isin(with_pbpo)],
    )


@pytest.mark.parametrize(
    "query",
    [
        {"from": "2026-03-02"},
        {"to": "2026-03-01"},
        {"from": "2026-03-01", "to": "2026-03-01"},
        {"completed": "true"},
        {"exclude_flagged": "true"},
        {"exclude_flag": ["fast"]},
        {"from": "", "to": "", "exclude_flag": ["faults", "unwatched"]},
        {"from": "2026-03-03"},
    ],
    ids=str,
)
def test_sessions_are_those_that_pandas_would_choose(data: Data, query: dict[str, Any]) -> None:
    sessions = data.table("sessions")
    begun = pd.to_datetime(sessions["started_at"]).dt.date
    flags = sessions["flags"].fillna("").str.split("; ").map(set)
    assert flags.to_list() == [{"fast"}, {""}]
    wanted = pd.Series(data=True, index=sessions.index)
    if query.get("from"):
        wanted &= begun >= date.fromisoformat(query["from"])
    if query.get("to"):
        wanted &= begun <= date.fromisoformat(query["to"])
    if "completed" in query:
        wanted &= sessions["stage"] == "completed"
    if "exclude_flagged" in query:
        wanted &= flags == {""}
    for flag in query.get("exclude_flag", ()):
        wanted &= ~flags.map(lambda held, flag=flag: flag in held)
    same(data.table("sessions", **query), sessions[wanted])
    kept = sessions.loc[wanted, ["session_id", "participant_id"]]
    for name in OF_SESSIONS[1:]:
        rows = data.table(name)
        key = "participant_id" if name == "participants" else "session_id"
        same(data.table(name, **query), rows[rows[key].isin(kept[key])])


@pytest.mark.parametrize(
    ("query", "status", "sentence"),
    [
        ({"condition": "pbpo-2"}, 409, "expected conditions among pbpo, no-synthesis, no-skip"),
        ({"from": "2026-03-02", "to": "2026-03-01"}, 409, "expected a last day on or after"),
        ({"from": "yesterday"}, 422, "from"),
        ({"exclude_flag": "slow"}, 422, "exclude_flag"),
        ({"format": "pickle"}, 422, "format"),
    ],
)
def test_a_filter_that_cannot_be_meant_is_named(
    data: Data, query: dict[str, str], status: int, sentence: str
) -> None:
    refused = data.get("export.zip", **query)
    assert (refused.status_code, sentence in refused.text) == (status, True), refused.text
    assert data.trail(*export.ACTIONS) == []


def test_a_filter_in_words_says_all_that_was_asked_for(data: Data) -> None:
    asked = Request(
        data.study, ("live",), ("pbpo",), FIRST_DAY, SECOND_DAY, (Flag.FAST,), completed=True
    )
    assert export.in_words(asked) == (
        "mode: live; conditions: pbpo; begun from 2026-03-01; begun until 2026-03-02;"
        " completed only; without the flags fast"
    )


@pytest.mark.parametrize("form", list(export.FORMATS))
def test_an_export_is_noted_with_the_hash_of_its_bytes(data: Data, clock: Clock, form: str) -> None:
    taken = data.get("export.zip", format=form, completed="true")
    (line,) = data.trail(EXPORTED)
    assert (line.actor, line.happened_at) == (EMAIL, clock.now())
    assert line.details["format"] == form
    assert line.details["filter"] == "mode: live; completed only"
    assert list(line.details["files"].values()) == [hashlib.sha256(taken.content).hexdigest()]
    assert "incomplete" not in line.details


def test_identities_are_noted_as_an_action_of_their_own(data: Data) -> None:
    taken = data.get("export/identities.csv")
    (line,) = data.trail(IDENTITIES)
    assert line.details["files"] == {"identities.csv": hashlib.sha256(taken.content).hexdigest()}
    assert data.trail(EXPORTED) == []


def test_a_download_that_is_broken_off_is_noted_as_incomplete(data: Data) -> None:
    got: list[bytes] = []

    async def leave_early(client: httpx.AsyncClient) -> None:
        """Ask, take the beginning, and be gone: the server's next piece finds nobody."""
        gone = False

        async def receive() -> dict[str, Any]:
            return {"type": "http.disconnect"} if gone else {"type": "http.request", "body": b""}

        async def send(message: dict[str, Any]) -> None:
            nonlocal gone
            if message.get("body"):
                got.append(message["body"])
                gone = True
                raise OSError("nobody reads any more")

        application: Any = client._transport.app  # type: ignore[attr-defined]
        scope = {
            "type": "http",
            "asgi": {"version": "3.0", "spec_version": "2.4"},
            "method": "GET",
            "scheme": "http",
            "path": "/api/v1/studies/short/export/queries.csv",
            "raw_path": b"/api/v1/studies/short/export/queries.csv",
            "query_string": b"",
            "root_path": "",
            "headers": [(b"authorization", f"Bearer {data.api_token}".encode())],
            "http_version": "1.1",
            "client": ("127.0.0.1", 1),
            "server": ("127.0.0.1", 80),
        }
        with pytest.raises(Exception):  # noqa: B017, PT011 - whatever the server's stack makes of it
            await application(scope, receive, send)

    data.client.run(leave_early)
    (line,) = data.trail(EXPORTED)
    assert line.details["incomplete"] == f"broken off after {len(got[0])} bytes"
    assert line.details["files"] == {}


def write(data: Data, folder: Path, **more: Any) -> list[Path]:
    request = export.resolve_flags(data.app, Request(data.study))
    files = export.FORMATS["csv"].files(request)
    return export.write_folder(data.app, "me", request, "csv", files, folder, **more)


def test_a_folder_takes_a_newer_export_but_nothing_else_is_lost(data: Data, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    paths = write(data, folder)
    digests = data.trail(EXPORTED)[0].details["files"]
    assert digests == {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in paths}
    before = (folder / "queries.csv").read_bytes()
    data.client.start().to_first_query().respond("left")
    write(data, folder)
    after = (folder / "queries.csv").read_bytes()
    assert len(after) > len(before)

    (folder / "sessions.csv").write_text("what I worked on all day\n")
    data.client.start()
    with pytest.raises(ConflictError, match=r"or --overwrite: .*sessions.csv holds something else"):
        write(data, folder)
    assert (folder / "sessions.csv").read_text() == "what I worked on all day\n"
    assert (folder / "queries.csv").read_bytes() == after
    assert {path.name for path in folder.iterdir()} == {path.name for path in paths}
    write(data, folder, overwrite=True)
    assert len(pd.read_csv(folder / "sessions.csv")) == 4


@pytest.mark.parametrize(("form", "read"), [("csv", 2), ("psych-ds", 4), ("botorch", 2)])
def test_all_of_a_zip_is_of_one_moment(data: Data, form: str, read: int) -> None:
    session = data.client.start().to_first_query()
    request = export.resolve_flags(data.app, Request(data.study))

    def pieces() -> Iterator[bytes]:
        return export.zip_stream(data.app, export.FORMATS[form].files(request))

    before = b"".join(pieces())
    begun = pieces()
    first = [next(begun) for _ in range(read)]
    assert session.respond("left").status_code == 200
    assert b"".join([*first, *begun]) == before
    assert b"".join(pieces()) != before


def test_all_of_a_folder_is_of_one_moment(data: Data, tmp_path: Path) -> None:
    def counted(db: Session) -> Iterator[bytes]:
        yield str(db.scalar(select(func.count(SessionRow.id)))).encode()

    def meanwhile(_: Session) -> Iterator[bytes]:
        data.client.start()
        yield b"somebody came"

    files = [File("a", counted), File("b", meanwhile), File("c", counted)]
    request = export.resolve_flags(data.app, Request(data.study))
    a, _, c = export.write_folder(data.app, "me", request, "csv", files, tmp_path)
    assert a.read_text() == c.read_text()


def test_the_page_downloads_what_its_form_asks_for_and_lists_what_was_taken(
    data: Data, app: AppContext
) -> None:
    desk = Desk(data.client, app, "grace@lab.example", Role.ADMIN)
    page = desk.get("/studies/short/data")
    assert page.status_code == 200
    assert "Nothing yet." in page.text
    for name in ("pbpo", "no-synthesis", "no-skip"):
        assert f'name="condition" value="{name}"' in page.text
    taken = desk.get(
        "/studies/short/data/download?format=botorch&mode=live&from=&to=2026-03-01&condition=pbpo"
    )
    assert taken.headers["content-disposition"] == 'attachment; filename="short-botorch.zip"'
    page = desk.get("/studies/short/data")
    assert hashlib.sha256(taken.content).hexdigest() in page.text
    assert "mode: live; conditions: pbpo; begun until 2026-03-01" in page.text
    assert "grace@lab.example" in page.text
    refused = desk.get("/studies/short/data/download?from=2026-03-02&to=2026-03-01")
    assert refused.status_code == 409
    assert "Expected a last day on or after the first, 2026-03-02" in html.unescape(refused.text)


def test_who_may_not_see_a_studys_data_gets_none_of_it(data: Data, app: AppContext) -> None:
    reviewer = Desk(data.client, app, "irb@lab.example", Role.REVIEWER)
    stranger = Desk(data.client, app, "eve@lab.example", Role.EXPERIMENTER)
    for path in ("data", "data/download", "data/report.pdf"):
        assert reviewer.get(f"/studies/short/{path}").status_code == 403
        assert stranger.get(f"/studies/short/{path}").status_code == 404
    for path in ("export.zip?format=botorch", "report.html", "export/identities.csv"):
        assert reviewer.get(f"/api/v1/studies/short/{path}").status_code == 403
        assert stranger.get(f"/api/v1/studies/short/{path}").status_code == 404
    assert data.trail(*export.ACTIONS) == []
    assert accounts.find(app, "eve@lab.example").role is Role.EXPERIMENTER


def tables_of(report: reporting.Report) -> dict[str, dict[str, tuple[str, ...]]]:
    """The rows of each table, by its caption and their first cells."""
    return {
        block.caption: {row[0]: row[1:] for row in block.rows}
        for block in report.blocks
        if isinstance(block, Table)
    }


def _rows(data: Data, request: Request, caption: str) -> list[tuple[str, ...]]:
    blocks = reporting.describe(data.app, request).blocks
    return [
        row
        for block in blocks
        if isinstance(block, Table) and block.caption.startswith(caption)
        for row in block.rows
    ]


def test_the_reports_numbers_are_those_of_the_tables(data: Data) -> None:
    request = export.resolve_flags(data.app, Request(data.study, completed=True))
    found = tables_of(reporting.describe(data.app, request))
    sessions = data.table("sessions")
    queries = data.table("queries", completed="true")
    flow = {
        step: int(number[0])
        for step, number in found["Sessions, from arriving to being counted"].items()
    }
    assert flow == {
        "Arrived": len(sessions),
        "Deleted at their person's wish": 0,
        "Declined to consent": 0,
        "Screened out": 0,
        "Consented": int(sessions["consented_at"].notna().sum()),
        "Began the queries": data.table("queries")["session_id"].nunique(),
        "Withdrew": 0,
        "Not finished": int((sessions["stage"] == "query").sum()),
        "Completed": int((sessions["stage"] == "completed").sum()),
        "Left out by the filter": 1,
        "Without an answer that counts": 0,
        "Counted in this report": 1,
    }
    engines = found["Engines that chose the queries"]
    assert {engine: int(n[0]) for engine, n in engines.items()} == {
        str(engine): number for engine, number in queries["engine_version"].value_counts().items()
    }
    assert found["What was noticed of sessions"]["Fast answers"][0] == "1"
    (plan,) = found["Plans that sessions ran under"].values()
    in_trials = queries[queries["trial_index"] >= 0]["response"].notna().sum()
    assert plan == (sessions["plan_hash"].iloc[0], "1", str(in_trials))
    assert found["What this report is about"]["First session"] == (
        f"{sessions['started_at'].min()[:10]} UTC",
    )
    assert found["What this report is about"]["Languages"] == ("en 1",)
    assert found["Orders of conditions that were given"].popitem()[1] == ("1",)
    settings = _rows(data, request, "Settings of the optimisers")
    assert ("random_queries", "2") in {row[1:] for row in settings}
    assert found["Consents that were agreed to"].keys() == set(sessions["consent_version"])


def test_the_tests_of_a_report_are_those_of_scipy(data: Data, clock: Clock) -> None:
    data.client.start().to_the_end(by_turns("left", "right", "right"), clock.forward)
    acquired, queries = data.table("acquired"), data.table("queries")
    scores = data.table("recordings").groupby("candidate")["score"].mean()
    # The study has five queries a trial: what is looked at is what was acquired after the fifth.
    last = acquired[acquired["query_index"] == 4].merge(
        queries.drop_duplicates(["session_id", "trial_index"])[
            ["session_id", "trial_index", "condition"]
        ],
        on=["session_id", "trial_index", "condition"],
    )
    samples = scores[last["candidate"]].groupby(last["condition"].to_numpy()).apply(list)
    report = reporting.describe(data.app, Request(data.study))
    said = " ".join(getattr(block, "text", "") for block in report.blocks)
    for condition, values in samples.items():
        assert f"{condition} {sum(values) / 2:.1f} (2 trials)" in said
    (table,) = (
        b
        for b in report.blocks
        if isinstance(b, Table) and b.caption.startswith("Unpaired t-tests")
    )
    assert len(table.rows) == 3
    for environment, answers, pair, trials, _difference, t, p, *_welch in table.rows:
        assert (environment, answers, trials) == ("env1", "5", "2, 2")
        first, second = pair.split(" – ")
        expected = ttest_ind(samples[first], samples[second])
        assert t == f"t(2) = {expected.statistic:.3f}"
        assert float(p.removeprefix("p = ")) == pytest.approx(expected.pvalue, abs=6e-4)


def test_a_report_is_html_and_pdf_of_one_description_and_the_same_each_time(
    data: Data, app: AppContext
) -> None:
    page, file = data.get("report.html"), data.get("report.pdf")
    assert page.headers["content-security-policy"].startswith("sandbox; default-src 'none';")
    assert 'filename="short-report.html"' in page.headers["content-disposition"]
    assert (page.content, file.content) == (
        data.get("report.html").content,
        data.get("report.pdf").content,
    )
    report = reporting.describe(app, Request(data.study))
    with pypdfium2.PdfDocument(file.content) as opened:
        assert opened.get_metadata_dict()["Title"] == "A short study"
        text = " ".join(sheet.get_textpage().get_text_range() for sheet in opened)
    squeezed = re.sub(r"[\s\u200b\ufffe-]+", "", text)
    for block in report.blocks:
        if isinstance(block, Table):
            for row in block.rows:
                for value in row:
                    assert html.escape(value) in page.text
                    assert re.sub(r"[\s-]+", "", value) in squeezed, value
    figures = [block for block in report.blocks if isinstance(block, Figure)]
    assert len(figures) >= 5
    assert page.text.count("<img alt=") == len(figures)
    assert "<script" not in page.text
    digest = hashlib.sha256(data.get("export/queries.csv").content).hexdigest()
    assert digest in page.text
    assert [line.details["format"] for line in data.trail(REPORTED)] == ["report"] * 4


def test_a_report_on_nobody_says_so(data: Data, app: AppContext) -> None:
    request = export.resolve_flags(app, Request(data.study, since=date(2030, 1, 1)))
    report = reporting.describe(app, request)
    assert not [block for block in report.blocks if isinstance(block, Figure)]
    assert b"no session yet" in reporting.html(report)
    assert reporting.pdf(report).startswith(b"%PDF-")


def test_a_text_that_looks_like_markup_stays_a_text(data: Data, app: AppContext) -> None:
    nasty = '<script>alert(1)</script> #panic("typst") *x* $y$ \\'
    made = reporting.Report(nasty, nasty, [Table(nasty, (nasty,), [(nasty,)])])
    assert b"<script" not in reporting.html(made)
    with pypdfium2.PdfDocument(reporting.pdf(made)) as opened:
        assert '#panic("typst") *x* $y$' in opened[0].get_textpage().get_text_range()


def test_the_clock_of_an_export_is_the_studios(data: Data, clock: Clock) -> None:
    clock.forward(60)
    data.get("export/sessions.csv")
    assert data.trail(EXPORTED)[0].happened_at == clock.now() > datetime(2026, 3, 1, tzinfo=UTC)
