"""Studies in the database: creating drafts, reading, opening and closing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from threading import Lock
from typing import Any

from cachetools import LRUCache, cached
from sqlalchemy import delete, func, insert, select
from sqlalchemy.orm import Session

from app.crane import environments as crane_environments
from app.crane import library
from app.crane.dynamics import DURATION_S
from app.pbbo import Settings as OptimizerSettings
from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.proposals import boxes
from app.services.recordings import metadata_removal, recordings
from app.services.runtime import disk_quota
from app.services.runtime.errors import ConflictError, NotFoundError, SlugTakenError
from app.services.runtime.ids import new_public_id
from app.storage.models.accounts import StudyAccess
from app.storage.models.studies import Candidate, PlanVersion, Recording, SessionRow, Study
from app.study import assignment, doubts
from app.study import folder as study_folder
from app.study.environments import CRANE_PARAMETERS
from app.study.plan import Plan, plan_hash
from app.study.recordings import Value
from app.study.validation_errors import Fault, StudyFaults

from . import orphaned_videos, slugs

#: Markdown texts of a study, by language and name.
Texts = Mapping[str, Mapping[str, str]]

DRAFT = "draft"
OPEN = "open"
CLOSED = "closed"

#: Kinds of membership of an account in a study.
OWNER = "owner"
SHARED = "shared"

#: How many parsed plan versions are cached; parsing one takes longer than a response may.
MAX_PLANS = 256
#: Plans and texts by their hash, and plans reduced to some of their conditions.
_plans: LRUCache[str, Plan] = LRUCache(MAX_PLANS)
_texts: LRUCache[str, Texts] = LRUCache(MAX_PLANS)
_narrowed_plans: LRUCache[tuple[str, frozenset[int]], Plan] = LRUCache(4 * MAX_PLANS)
_lock = Lock()


@dataclass(frozen=True)
class StudyInfo:
    """A study with its newest plan version."""

    id: int
    slug: str
    status: str
    plan: Plan
    texts: Texts
    plan_id: int
    plan_hash: str
    plan_version: int
    created_at: datetime
    opened_at: datetime | None
    closed_at: datetime | None
    paused_at: datetime | None = None
    conditions_off: tuple[str, ...] = ()


def settings_fault(settings: Mapping[str, Any]) -> str | None:
    """The error in a condition's optimiser settings as a sentence; None if they are valid."""
    try:
        OptimizerSettings.from_mapping(settings)
    except ValueError as error:
        return str(error)
    return None


def load_folder(name_or_path: str) -> study_folder.StudyFolder:
    """Read and validate a study's folder, or a shipped study by its name.

    Raises StudyFaults with all validation errors.
    """
    found = examine_folder(name_or_path)
    if found.study is None:
        raise StudyFaults(found.faults)
    return found.study


def examine_folder(name_or_path: str) -> study_folder.Examination:
    """Check a study's folder, or a shipped study by its name."""
    return study_folder.examine(
        study_folder.resolve(name_or_path),
        settings_check=settings_fault,
        space_check=boxes.space_faults,
        crane_candidates=lambda _: crane_environments.candidates().tolist(),
    )


def doubts_on(study: study_folder.StudyFolder) -> list[Fault]:
    """What a person would ask about a valid study before it is opened."""
    return doubts.doubts(study.plan, study.texts, study.recordings, study.unused, random_queries)


def random_queries(settings: Mapping[str, Any]) -> int:
    """How many queries of a trial are random pairs under these settings of a condition."""
    return OptimizerSettings.from_mapping(settings).random_queries


def create(
    app: AppContext,
    folder: study_folder.StudyFolder,
    owner_id: int | None = None,
    *,
    actor: str = audit_log.COMMAND_LINE,
    may_replace: Callable[[Session, int], bool] = lambda _db, _study_id: True,
    proof: slugs.Proof = slugs.NONE,
) -> StudyInfo:
    """Store a study as a draft, in place of an earlier draft that is proven to be the same study.

    That is the case if the draft was created from the same folder, or if `proof` shows it. An
    earlier draft's owner and members are kept. A draft with the same plan, texts and recordings is
    returned unchanged.

    owner_id: the account that will own the study; None leaves it to the admins. may_replace: called
    with `db` and the id of an earlier draft; whether the caller may replace it.

    Raises SlugTakenError if another draft has the slug, and ConflictError if a study with the slug
    is or was open, since its plan is final.
    """
    plan = folder.plan
    if plan.slug in slugs.RESERVED:
        raise ConflictError(f"expected another slug: {plan.slug!r} is a page of the studio's own")
    sizes = ((folder.root / row.file).stat().st_size for row in folder.recordings)
    disk_quota.require(app.settings, app.settings.own_videos, sum(sizes))
    with metadata_removal.videos(app.settings, folder) as made:
        videos = {video.name: video for video in made.values()}
        locators = {sha256: video.name for sha256, video in made.items()}
        with orphaned_videos.mark_in_use(app, videos.keys()):
            # Videos are stored first, named by their content: an unreferenced one does no harm.
            app.recordings.keep_files(videos)
            return _stored(app, folder, locators, owner_id, actor, may_replace, proof)


def _stored(
    app: AppContext,
    folder: study_folder.StudyFolder,
    locators: Mapping[str, str],
    owner_id: int | None,
    actor: str,
    may_replace: Callable[[Session, int], bool],
    proof: slugs.Proof,
) -> StudyInfo:
    plan = folder.plan
    candidates = list(_candidates(folder, locators))
    digest = plan_hash(plan, folder.texts, folder.recordings)
    made_of = slugs.folder_hash(folder.root)
    with app.database.write() as db:
        earlier = db.scalar(select(Study).where(Study.slug == plan.slug).with_for_update())
        members = {} if owner_id is None else {owner_id: OWNER}
        if earlier is not None:
            if not may_replace(db, earlier.id):
                raise SlugTakenError(f"expected another slug: {plan.slug!r} is taken")
            if earlier.status == DRAFT:
                if earlier.plans[-1].plan_hash == digest:
                    return _info(earlier, earlier.plans[-1])
                slugs.require_same(db, earlier, made_of, proof)
            members = _members(db, earlier.id) or members
            had = orphaned_videos.of_study(db, earlier.id)
            _delete_draft(db, earlier)
            orphaned_videos.mark_orphaned(app, had)
        now = app.now()
        study = Study(slug=plan.slug, status=DRAFT, created_at=now)
        version = PlanVersion(
            study=study,
            version=1,
            plan_hash=digest,
            plan=plan.model_dump(mode="json"),
            texts={language: dict(texts) for language, texts in folder.texts.items()},
            created_at=now,
        )
        db.add_all([study, version])
        db.flush()
        if candidates:
            _store(db, study.id, candidates)
        db.add_all(
            StudyAccess(study_id=study.id, account_id=account_id, access=access, created_at=now)
            for account_id, access in members.items()
        )
        db.flush()
        details = {"plan_hash": digest, slugs.FOLDER: made_of}
        audit_log.note(db, now, actor, slugs.CREATED, study.slug, **details)
        return _info(study, version)


def _members(db: Session, study_id: int) -> dict[int, str]:
    """The kinds of membership in a study, by account id."""
    members = db.scalars(select(StudyAccess).where(StudyAccess.study_id == study_id))
    return {access.account_id: access.access for access in members}


def find(app: AppContext, slug: str) -> StudyInfo:
    """The study with this slug, with its newest plan. Raises NotFoundError."""
    with app.database.read() as db:
        return read(db, slug)


def read(db: Session, slug: str) -> StudyInfo:
    """As `find`, within the transaction of `db`."""
    study = db.scalar(select(Study).where(Study.slug == slug))
    if study is None:
        raise NotFoundError(f"there is no study named {slug!r}")
    return _info(study, study.plans[-1])


def all_studies(app: AppContext) -> list[StudyInfo]:
    """All studies, the newest first."""
    with app.database.read() as db:
        rows = db.scalars(select(Study).order_by(Study.created_at.desc(), Study.id.desc()))
        return [_info(study, study.plans[-1]) for study in rows]


def open_study(app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE) -> StudyInfo:
    """Open a study for participants.

    Opening an open study changes nothing. Raises NotFoundError.
    """
    return _set_status(app, slug, OPEN, actor)


def close_study(app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE) -> StudyInfo:
    """Admit no further sessions; sessions under way may finish.

    Raises NotFoundError, or ConflictError for a draft.
    """
    return _set_status(app, slug, CLOSED, actor)


def lock_study(db: Session, slug: str) -> Study:
    """Lock the study's row until the transaction ends. Raises NotFoundError."""
    study = db.scalar(select(Study).where(Study.slug == slug).with_for_update())
    if study is None:
        raise NotFoundError(f"there is no study named {slug!r}")
    return study


def _delete_draft(db: Session, study: Study) -> None:
    if study.status != DRAFT:
        raise ConflictError(
            f"expected a draft or a new slug, and the study {study.slug!r} is {study.status}"
        )
    delete_row(db, study)


def delete_row(db: Session, study: Study) -> None:
    """Delete a study with all dependent rows."""
    db.expunge(study)
    # Dependent rows are deleted by cascading foreign keys. Sessions go first: their queries refer
    # to recordings, which PostgreSQL would not delete before them.
    db.execute(delete(SessionRow).where(SessionRow.study_id == study.id))
    db.execute(delete(Study).where(Study.id == study.id))


def recording_count(app: AppContext, study_id: int) -> int:
    """The number of a study's recordings."""
    with app.database.read() as db:
        return (
            db.scalar(
                select(func.count(Recording.id))
                .join(Candidate, Recording.candidate_id == Candidate.id)
                .where(Candidate.study_id == study_id)
            )
            or 0
        )


def _set_status(app: AppContext, slug: str, status: str, actor: str) -> StudyInfo:
    with app.database.write() as db:
        study = lock_study(db, slug)
        if study.status == DRAFT and status == CLOSED:
            raise ConflictError(f"expected an open study to close, and {slug!r} is a draft")
        if study.status != status:
            study.status, study.paused_at = status, None
            now = app.now()
            if status == OPEN:
                study.opened_at = study.opened_at or now
                study.closed_at = None
            else:
                study.closed_at = now
            done = "study opened" if status == OPEN else "study closed"
            frozen = study.plans[-1].plan_hash
            audit_log.note(db, now, actor, done, slug, plan_hash=frozen)
        return _info(study, study.plans[-1])


@cached(_plans, key=lambda version: version.plan_hash, lock=_lock)
def stored_plan(version: PlanVersion) -> Plan:
    """The parsed plan of a version, cached, since a stored plan never changes."""
    return Plan.model_validate(version.plan)


@cached(_texts, key=lambda version: version.plan_hash, lock=_lock)
def stored_texts(version: PlanVersion) -> Texts:
    """The texts of a version, cached."""
    return version.texts


def plan_of(session: SessionRow) -> Plan:
    """The plan without the conditions that were switched off when this session started.

    It gives the numbers of trials and blocks. `SessionRow.trial_conditions` are indices into the
    conditions of the whole plan.
    """
    return _narrowed(
        session.plan.plan_hash, stored_plan(session.plan), frozenset(session.trial_conditions)
    )


def _narrowed(digest: str, plan: Plan, conditions: frozenset[int]) -> Plan:
    if len(conditions) == len(plan.conditions):
        return plan
    return _narrowed_to(digest, plan, conditions)


@cached(_narrowed_plans, key=lambda digest, _, conditions: (digest, conditions), lock=_lock)
def _narrowed_to(digest: str, plan: Plan, conditions: frozenset[int]) -> Plan:
    return assignment.narrowed(plan, conditions)


def _info(study: Study, version: PlanVersion) -> StudyInfo:
    return StudyInfo(
        id=study.id,
        slug=study.slug,
        status=study.status,
        plan=stored_plan(version),
        texts=version.texts,
        plan_id=version.id,
        plan_hash=version.plan_hash,
        plan_version=version.version,
        created_at=study.created_at,
        opened_at=study.opened_at,
        closed_at=study.closed_at,
        paused_at=study.paused_at,
        conditions_off=tuple(study.conditions_off),
    )


@dataclass(frozen=True)
class _CandidateRows:
    """Columns of a candidate's row and of its recordings' rows, for bulk inserts."""

    candidate: Mapping[str, Any]
    recordings: list[dict[str, Any]]


def _store(db: Session, study_id: int, candidates: Sequence[_CandidateRows]) -> None:
    ids = db.scalars(
        insert(Candidate).returning(Candidate.id, sort_by_parameter_order=True),
        [{"study_id": study_id, **rows.candidate} for rows in candidates],
    )
    db.execute(
        insert(Recording),
        [
            {"candidate_id": candidate_id, "public_id": new_public_id(), **recording}
            for candidate_id, rows in zip(ids, candidates, strict=True)
            for recording in rows.recordings
        ],
    )


def _candidates(
    folder: study_folder.StudyFolder, locators: Mapping[str, str]
) -> Iterator[_CandidateRows]:
    for name, environment in folder.plan.environments.items():
        if environment.is_machine:
            continue  # Its candidates are stored when they are proposed.
        if environment.is_crane:
            yield from _crane_candidates(name)
        else:
            yield from _file_candidates(folder, locators, name)


def _crane_candidates(environment: str) -> Iterator[_CandidateRows]:
    scores = library.scores(environment)  # (231, 5)
    for index, values in enumerate(crane_environments.candidates()):
        yield _CandidateRows(
            {
                "environment": environment,
                "candidate_index": index,
                "parameters": dict(zip(CRANE_PARAMETERS, map(float, values), strict=True)),
            },
            [
                {
                    "run_index": run,
                    "source": recordings.CRANE,
                    "locator": recordings.crane_locator(environment, index, run),
                    "file": None,
                    "duration_s": DURATION_S,
                    "score": float(scores[index, run]),
                }
                for run in range(scores.shape[1])
            ],
        )


def _file_candidates(
    folder: study_folder.StudyFolder, locators: Mapping[str, str], environment: str
) -> Iterator[_CandidateRows]:
    names = [parameter.name for parameter in folder.plan.parameters]
    found: dict[tuple[Value, ...], _CandidateRows] = {}
    for row in folder.recordings:
        if row.environment != environment:
            continue
        rows = found.get(row.candidate)
        if rows is None:
            rows = found[row.candidate] = _CandidateRows(
                {
                    "environment": environment,
                    "candidate_index": len(found),
                    "parameters": dict(zip(names, row.candidate, strict=True)),
                },
                [],
            )
        rows.recordings.append(
            {
                "run_index": len(rows.recordings),
                "source": recordings.FILE,
                "locator": locators[row.sha256],
                "file": row.file,
                "duration_s": row.duration_s,
                "score": row.score,
            }
        )
    yield from found.values()
