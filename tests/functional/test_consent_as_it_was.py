"""Each answer keeps the consent that it was given under: a renewed consent rewrites no history."""

from __future__ import annotations

import importlib
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from app.services import reporting
from app.services.context import AppContext
from app.services.export.table import Request
from app.services.reporting.document import Table
from app.services.sessions import withdrawal
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock, database_file

from .client import Api, Session
from .test_revised_texts import revise


def tables(app: AppContext) -> dict[str, list[tuple[str, ...]]]:
    report = reporting.describe(app, Request(repository.find(app, "short")))
    return {b.caption: list(b.rows) for b in report.blocks if isinstance(b, Table)}


@pytest.fixture
def renewed(
    client: Api, app: AppContext, short_study: StudyInfo, clock: Clock, tmp_path: Path
) -> Session:
    """Two answers under the first consent, one under the second, and a query that is open."""
    session = client.start().to_first_query()
    for seconds in (0, 5):
        clock.forward(seconds)
        session.respond("left")
    revise(app, tmp_path / "new")
    clock.forward(60)
    assert session.look()["stage"] == "consent"
    assert session.consent().status_code == 200
    clock.forward(5)
    session.respond("right")
    return session


def test_every_answer_has_the_consent_and_plan_that_it_was_given_under(
    client: Api, renewed: Session, api_token: str
) -> None:
    queries = client.table("queries", api_token).sort_values("query_index")
    consents = client.table("consents", api_token)
    first, second = consents["consent_version"]
    assert first != second
    assert queries["consent_version"].to_list() == [first, first, second, second]
    assert queries["plan_hash"].to_list() == [consents["plan_hash"][at] for at in (0, 0, 1, 1)]
    assert consents["consent_index"].to_list() == [0, 1]
    assert consents["agreed_at"].is_monotonic_increasing
    answers = queries.dropna(subset="response")
    for version, agreed_at in zip(consents["consent_version"], consents["agreed_at"], strict=True):
        under = answers[answers["consent_version"] == version]
        assert (under["answered_at"] >= agreed_at).all()
    session = client.table("sessions", api_token).iloc[0]
    assert session["consent_version"] == second
    assert session["consented_at"] == consents["agreed_at"][1]


def test_the_report_counts_answers_by_the_consent_they_were_given_under(
    client: Api, app: AppContext, renewed: Session, api_token: str
) -> None:
    found = tables(app)
    assert [row[2:] for row in found["Plans that sessions ran under"]] == [("1", "2"), ("1", "1")]
    counted = {row[0]: row[1:] for row in found["Consents that were agreed to"]}
    first, second = client.table("consents", api_token)["consent_version"]
    assert counted == {first: ("1", "2"), second: ("1", "1")}


def test_an_undone_answer_is_given_again_under_the_consent_of_that_time(
    client: Api, renewed: Session, api_token: str
) -> None:
    assert renewed.respond("left").status_code == 200
    queries = client.table("queries", api_token).sort_values("query_index")
    assert queries["consent_version"].nunique() == 2


def test_agreements_go_with_their_session(
    client: Api, app: AppContext, renewed: Session, api_token: str
) -> None:
    assert len(client.table("consents", api_token)) == 2
    withdrawal.withdraw_and_delete(app, renewed.token)
    assert client.table("consents", api_token).empty
    assert client.table("queries", api_token).empty


def test_nobody_who_declined_is_in_the_table_of_consents(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    client.start().call("withdraw")
    assert client.table("consents", api_token).empty


@pytest.mark.sqlite
@pytest.mark.parametrize("renewals", [1, 2])
def test_of_older_data_what_is_known_is_kept_and_what_is_not_is_left_open(
    client: Api, app: AppContext, renewed: Session, api_token: str, renewals: int
) -> None:
    """The former version had left the former consent in an event, and no times."""
    before = client.table("queries", api_token).sort_values("query_index")
    first, second = client.table("consents", api_token)["consent_version"]
    with closing(sqlite3.connect(database_file(app.settings))) as file, file:
        file.execute("DROP TABLE consents")
        file.execute("DROP TABLE declined_counts")
        file.execute("UPDATE alembic_version SET version_num = '0005'")
        for former in (first, "f00f00f00f00")[:renewals]:
            file.execute(
                "INSERT INTO events (session_id, trial_index, query_index, event, time_ms, value)"
                " SELECT id, -1, -1, 'consent_renewed', 0, ? FROM sessions",
                (former,),
            )
        from alembic.migration import MigrationContext
        from alembic.operations import Operations
        from sqlalchemy import create_engine

        engine = create_engine(f"sqlite:///{database_file(app.settings)}")
        file.commit()
        with engine.begin() as connection:
            with Operations.context(MigrationContext.configure(connection)) as op:
                with op.batch_alter_table("responses") as batch:
                    batch.drop_column("plan_id")
                importlib.import_module("migrations.versions.0006_consents").upgrade()
            connection.exec_driver_sql("UPDATE alembic_version SET version_num = '0006'")
        engine.dispose()
    consents = client.table("consents", api_token)
    assert consents["consent_version"].to_list() == [first, second]
    assert consents["agreed_at"].isna().to_list() == [True, False]
    after = client.table("queries", api_token).sort_values("query_index")
    if renewals == 1:
        assert after.equals(before)
    else:
        # Under which of two former consents nobody can say.
        assert after["consent_version"].isna().to_list() == [True, True, False, False]
        assert after["plan_hash"].isna().to_list() == [True, True, False, False]
