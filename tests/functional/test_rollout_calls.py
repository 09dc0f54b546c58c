"""The calls of machines, right and wrong: claims, leases, heartbeats, and reports."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
from fastapi import FastAPI
from sqlalchemy import select, update

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.rollouts import claims, durations, lookup, machines, outcomes, requests
from app.services.rollouts.reports import LARGEST_SERIES
from app.services.runtime.errors import ConflictError, NotFoundError
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.storage.models.rollouts import Machine, Rollout
from app.storage.models.studies import Study
from app.web.api.machine_calls import BURST, CallLimit
from tests.conftest import Clock, StudyShelf

from .client import Api
from .house import routes
from .machine_study import POINTS, ROBOT_PLAN, Robot, add_candidates, ask, video_bytes
from .role_rules import ANYBODY, RULES, Rule


@pytest.fixture
def study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, ROBOT_PLAN)
    return repository.find(app, "robot")


@pytest.fixture
def candidates(app: AppContext, study: StudyInfo) -> list[int]:
    return add_candidates(app, study.slug)


@pytest.fixture
def new_robot(app: AppContext, client: Api, study: StudyInfo) -> Callable[[str], Robot]:
    return lambda name: Robot(client, machines.add(app, study.slug, name))


@pytest.fixture
def robot(new_robot: Callable[[str], Robot]) -> Robot:
    return new_robot("arm")


def row(app: AppContext, public_id: str) -> Rollout:
    with app.database.read() as db:
        return db.scalars(select(Rollout).where(Rollout.public_id == public_id)).one()


def test_a_machine_gets_the_parameters_a_seed_and_a_lease(
    app: AppContext, robot: Robot, candidates: list[int], clock: Clock
) -> None:
    asked = ask(app, candidates[12])
    found = robot.claimed()
    assert found["id"] == asked
    assert found["parameters"] == {"w0": POINTS[12][0], "w1": POINTS[12][1]}
    assert (found["environment"], found["seed"], found["attempt"]) == ("env1", 7, 1)
    assert found["lease"]["seconds"] == 60
    assert row(app, asked).status == "claimed"


def test_a_rollout_is_given_to_one_machine_only(
    app: AppContext, new_robot: Callable[[str], Robot], candidates: list[int]
) -> None:
    ask(app, candidates[0])
    assert new_robot("a").claim().status_code == 200
    assert new_robot("b").claim().status_code == 204


def test_what_a_query_waits_for_comes_before_what_is_asked_ahead_and_then_the_oldest(
    app: AppContext, robot: Robot, candidates: list[int], clock: Clock
) -> None:
    ahead = ask(app, candidates[0], reason=requests.AHEAD, priority=10)
    clock.forward(1)
    first = ask(app, candidates[1])
    clock.forward(1)
    second = ask(app, candidates[2])
    assert [robot.claimed()["id"] for _ in range(3)] == [first, second, ahead]


def test_a_machine_that_is_silent_loses_the_rollout_and_another_gets_it(
    app: AppContext, new_robot: Callable[[str], Robot], candidates: list[int], clock: Clock
) -> None:
    one, other = new_robot("one"), new_robot("other")
    asked = ask(app, candidates[0])
    one.claimed()
    clock.forward(59)
    assert other.claim().status_code == 204
    clock.forward(2)
    assert other.claimed()["attempt"] == 2
    assert one.beat(asked).json()["type"].endswith("lease-lost")
    assert one.failed(asked).status_code == 409
    assert [entry["machine"] for entry in row(app, asked).failures] == ["one"]


def test_heartbeats_keep_the_lease_and_tell_the_progress(
    app: AppContext, new_robot: Callable[[str], Robot], candidates: list[int], clock: Clock
) -> None:
    robot, other = new_robot("one"), new_robot("other")
    asked = ask(app, candidates[0])
    robot.claimed()
    for tenth in range(1, 10):
        clock.forward(20)
        answer = robot.beat(asked, progress=tenth / 10, attempt=1)
        assert answer.status_code == 200
        assert answer.json()["stopped"] is False
        assert other.claim().status_code == 204
    assert row(app, asked).progress == pytest.approx(0.9)
    # A machine that has sent heartbeats is missed sooner than one that sends none.
    clock.forward(46)
    assert other.claim().status_code == 200


def test_a_rollout_that_fails_is_tried_again_until_no_attempt_remains(
    app: AppContext, robot: Robot, candidates: list[int]
) -> None:
    asked = ask(app, candidates[0])
    robot.claimed()
    assert robot.failed(asked, "jammed").json() == {"status": "asked"}
    assert robot.failed(asked, "jammed").json() == {"status": "asked"}  # the same report again
    assert robot.claimed()["attempt"] == 2
    assert robot.failed(asked, "jammed again").json() == {"status": "failed"}
    assert robot.claim().status_code == 204
    found = row(app, asked)
    assert found.explanation == "jammed again"
    assert [entry["reason"] for entry in found.failures] == ["jammed", "jammed again"]


def test_a_rollout_that_is_given_back_counts_as_no_attempt(
    app: AppContext, robot: Robot, candidates: list[int]
) -> None:
    asked = ask(app, candidates[0])
    for _ in range(4):
        robot.claimed()
        assert robot.failed(asked, "Ctrl+C", give_back=True).json() == {"status": "asked"}


def test_unsafe_parameters_are_never_asked_for_again(
    app: AppContext, robot: Robot, study: StudyInfo, candidates: list[int]
) -> None:
    asked = ask(app, candidates[0])
    robot.claimed()
    assert robot.unsafe(asked).json() == {"status": "unsafe"}
    assert robot.unsafe(asked).status_code == 200
    assert robot.claim().status_code == 204
    with app.database.read() as db:
        assert lookup.unsafe_candidates(db, study.id, "env1") == {1000}
    with app.database.write() as db, pytest.raises(ConflictError):
        outcomes.retry(db, outcomes.locked(db, study.id, asked), "ada", app.now())


def test_a_machine_that_lost_its_lease_may_still_say_that_it_is_unsafe(
    app: AppContext, new_robot: Callable[[str], Robot], candidates: list[int], clock: Clock
) -> None:
    one, other = new_robot("one"), new_robot("other")
    asked = ask(app, candidates[0])
    one.claimed()
    clock.forward(61)
    other.claimed()
    assert one.unsafe(asked).status_code == 200
    assert row(app, asked).status == "unsafe"
    assert other.beat(asked).status_code == 409


def test_what_is_unsafe_after_it_was_recorded_is_kept_for_the_experimenter(
    app: AppContext, robot: Robot, candidates: list[int]
) -> None:
    asked = ask(app, candidates[0])
    robot.claimed()
    assert robot.put(asked, video_bytes()).status_code == 201
    assert robot.unsafe(asked, "it smokes").status_code == 409
    found = row(app, asked)
    assert found.status == "recorded"
    assert found.failures[-1]["reason"] == "unsafe: it smokes"


def test_the_emergency_stop_gives_no_work_and_tells_those_that_run(
    app: AppContext, robot: Robot, study: StudyInfo, candidates: list[int]
) -> None:
    running = ask(app, candidates[0])
    robot.claimed()
    ask(app, candidates[1])
    machines.stop(app, study.slug, "ada@lab.example")
    machines.stop(app, study.slug, "bob@lab.example")
    assert robot.claim().status_code == 204
    assert robot.beat(running).json()["stopped"] is True
    machines.release(app, study.slug, "ada@lab.example")
    assert robot.claim().status_code == 200
    assert robot.beat(running).json()["stopped"] is False
    said = [(line.actor, line.action) for line in audit_log.trail(app, study.slug)]
    assert said[:2] == [
        ("ada@lab.example", "machines released"),
        ("ada@lab.example", "machines stopped"),
    ]


def test_a_revoked_token_opens_nothing_at_once_and_its_rollouts_are_asked_again(
    app: AppContext, new_robot: Callable[[str], Robot], study: StudyInfo, candidates: list[int]
) -> None:
    robot, other = new_robot("one"), new_robot("other")
    asked = ask(app, candidates[0])
    robot.claimed()
    machines.revoke(app, study.slug, "one")
    for answer in (robot.claim(), robot.beat(asked), robot.put(asked, b"x"), robot.unsafe(asked)):
        assert answer.status_code == 401
    assert other.claimed()["id"] == asked


def test_a_revoked_name_can_have_a_new_token_and_one_in_use_cannot(
    app: AppContext, client: Api, study: StudyInfo
) -> None:
    first = machines.add(app, study.slug, "arm")
    with pytest.raises(ConflictError, match="revoke it first"):
        machines.add(app, study.slug, "arm")
    machines.revoke(app, study.slug, "arm")
    second = machines.add(app, study.slug, "arm")
    assert Robot(client, first).claim().status_code == 401
    assert Robot(client, second).claim().status_code == 204


@pytest.mark.parametrize("name", ["", " ", "a b", "-a", "é", "a/b", "x" * 61, "crane", "desk"])
def test_a_name_of_another_form_is_refused(app: AppContext, study: StudyInfo, name: str) -> None:
    with pytest.raises(ConflictError, match="expected"):
        machines.add(app, study.slug, name)


def test_a_study_without_machines_gets_none(app: AppContext, short_study: StudyInfo) -> None:
    with pytest.raises(ConflictError, match="source: machine"):
        machines.add(app, short_study.slug, "arm")
    with pytest.raises(NotFoundError):
        machines.revoke(app, short_study.slug, "arm")


def test_only_a_hash_of_the_token_is_stored(app: AppContext, study: StudyInfo) -> None:
    token = machines.add(app, study.slug, "arm")
    with app.database.read() as db:
        stored = db.scalars(select(Machine)).one()
        assert token not in map(str, vars(stored).values())


@pytest.mark.parametrize(
    "body",
    [
        {"wait_s": -1},
        {"wait_s": 1e9},
        {"wait_s": "1"},
        {"machine": 3},
        {"environments": "env1"},
        {"environments": ["env1"] * 21},
        {"other": 1},
        [],
    ],
)
def test_a_claim_that_cannot_be_understood_is_refused(robot: Robot, body: object) -> None:
    assert robot.post("claim", body).status_code == 422


def test_a_claim_for_another_machine_or_an_unknown_environment_says_so(robot: Robot) -> None:
    assert "'arm'" in robot.claim(machine="leg").json()["detail"]
    assert robot.claim(machine="arm").status_code == 204
    assert "env1" in robot.claim(environments=["moon"]).json()["detail"]
    assert robot.claim(environments=["env1"]).status_code == 204


def test_a_rollout_that_is_not_there_is_not_found(robot: Robot) -> None:
    for answer in (
        robot.beat("nowhere"),
        robot.failed("nowhere"),
        robot.unsafe("nowhere"),
        robot.measure("nowhere", score=1.0),
        robot.put("nowhere", b"x"),
    ):
        assert answer.status_code == 404, answer.text


def test_reasons_and_numbers_are_bounded(
    app: AppContext, robot: Robot, candidates: list[int]
) -> None:
    asked = ask(app, candidates[0])
    robot.claimed()
    assert robot.failed(asked, "x" * 2001).status_code == 422
    assert robot.failed(asked, "").status_code == 422
    assert robot.failed(asked, "a\0b").status_code == 422
    assert robot.beat(asked, progress=1.5).status_code == 422
    assert robot.measure(asked, score="3").status_code == 422
    assert robot.measure(asked, series=[1, 2]).status_code == 422
    assert robot.measure(asked, series={"x": "y" * (LARGEST_SERIES + 1)}).status_code == 409
    assert robot.measure(asked, series={"x": "y" * 700_000}).status_code == 413
    for number in ("NaN", "1e999"):
        answer = robot.api.post(
            f"{robot.base}/{asked}/measurements",
            content=f'{{"score": {number}}}',
            headers={**robot.headers, "Content-Type": "application/json"},
        )
        assert answer.status_code == 422
        answer = robot.api.post(
            f"{robot.base}/{asked}/measurements",
            content=f'{{"series": {{"x": [{number}]}}}}',
            headers={**robot.headers, "Content-Type": "application/json"},
        )
        assert answer.status_code == 409
    assert row(app, asked).status == "claimed"


def sent(rule: Rule) -> dict[str, Any]:
    """What a request that the rule describes carries."""
    return {"data": dict(rule.form)} if rule.form else {"json": rule.json}


def test_a_machines_token_opens_nothing_but_its_calls(
    app: AppContext, application: FastAPI, client: Api, robot: Robot
) -> None:
    """On every other route it is what no token at all is."""
    for route in sorted(routes(application)):
        if RULES[route] in (ANYBODY,) or "/rollouts/" in route:
            continue
        method, path = route.split(" ", 1)
        for name in ("slug", "public_id", "table", "form"):
            path = path.replace(f"{{{name}}}", {"slug": "robot", "table": "queries"}.get(name, "x"))
        if "{" in path or "/jobs/" in path:
            path = path.replace("{", "").replace("}", "")
        with_token, without = (
            client.request(method, path, **sent(RULES[route]), headers=headers)
            for headers in (robot.headers, {})
        )
        assert with_token.status_code == without.status_code, route


def test_no_other_credential_opens_a_machines_calls(
    app: AppContext, client: Api, study: StudyInfo, study_shelf: StudyShelf, api_token: str
) -> None:
    for token in (api_token, "x", "x" * 43, ""):
        assert Robot(client, token).claim().status_code == 401
    mine = machines.add(app, study.slug, "arm")
    # The same answer for another study as for one that does not exist.
    answers = [Robot(client, mine, slug).claim() for slug in ("other", "nowhere")]
    assert [answer.status_code for answer in answers] == [401, 401]
    assert answers[0].json() == answers[1].json()


def test_experimenters_see_queue_past_and_machines(
    app: AppContext, client: Api, robot: Robot, candidates: list[int], api_token: str
) -> None:
    asked = [ask(app, candidate) for candidate in candidates[:3]]
    robot.claimed()
    headers = {"Authorization": f"Bearer {api_token}"}
    path = "/api/v1/studies/robot/rollouts"
    found = client.get(path, headers=headers).json()
    assert [line["id"] for line in found["rollouts"]] == asked[::-1]
    assert found["machines"][0]["name"] == "arm"
    assert found["machines"][0]["connected"] is True
    assert found["stopped_at"] is None
    claimed = client.get(path, params={"status": "claimed"}, headers=headers).json()
    assert [line["machine"] for line in claimed["rollouts"]] == ["arm"]
    page = client.get(path, params={"limit": 2}, headers=headers).json()
    rest = client.get(path, params={"before": page["before"]}, headers=headers).json()
    assert [line["id"] for line in rest["rollouts"]] == asked[:1]
    assert client.get(path, headers=robot.headers).status_code == 401


def test_how_long_rollouts_take_is_the_median_of_the_last(
    app: AppContext, robot: Robot, study: StudyInfo, candidates: list[int], clock: Clock
) -> None:
    with app.database.read() as db:
        before = durations.expectation(db, study.id, "env1", app.now())
    assert before == durations.Expectation(None, 0)
    for shade, seconds in enumerate((5, 50, 7)):
        asked = ask(app, candidates[shade])
        robot.claimed()
        clock.forward(seconds)
        assert robot.put(asked, video_bytes(10 + shade)).status_code == 201
    with app.database.read() as db:
        assert durations.expectation(db, study.id, "env1", app.now()).usually_s == 7
        assert durations.connected(db, study.id, app.now()) == 1
    clock.forward(100)
    with app.database.read() as db:
        assert durations.connected(db, study.id, app.now()) == 0


def test_machines_that_claim_at_the_same_moment_never_get_the_same_rollout(
    app: AppContext, study: StudyInfo, candidates: list[int]
) -> None:
    for candidate in candidates:
        ask(app, candidate)
    names = [f"m{number}" for number in range(6)]
    callers = [
        machines.authenticate(app, study.slug, machines.add(app, study.slug, name))
        for name in names
    ]
    together = threading.Barrier(len(callers))
    claimed: list[str] = []

    def work(caller: machines.MachineCaller) -> None:
        together.wait()
        misses = 0
        while misses < 3:
            found = claims.claim(app, caller)
            if found is None:
                misses += 1
            else:
                claimed.append(found.public_id)

    threads = [threading.Thread(target=work, args=(caller,)) for caller in callers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(claimed) == len(candidates)
    assert Counter(claimed).most_common(1)[0][1] == 1


def test_a_machine_that_calls_without_end_is_told_to_wait() -> None:
    time = 0.0
    limit = CallLimit(lambda: time)
    assert all(limit.seconds_to_wait(1) == 0 for _ in range(BURST))
    assert limit.seconds_to_wait(1) > 0
    assert limit.seconds_to_wait(2) == 0
    time = 1.0
    assert limit.seconds_to_wait(1) == 0


def test_a_stopped_study_is_stopped_for_claims_that_are_under_way(
    app: AppContext, study: StudyInfo, candidates: list[int]
) -> None:
    ask(app, candidates[0])
    caller = machines.authenticate(app, study.slug, machines.add(app, study.slug, "arm"))
    with app.database.write() as db:
        db.execute(update(Study).values(machines_stopped_at=app.now()))
    assert claims.claim(app, caller) is None
