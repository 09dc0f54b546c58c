"""Errors of the use cases. One table in `app.web.http.problems` maps each to an HTTP status."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from app.study.questionnaire import AnswerFault


class ServiceError(Exception):
    """Base of all refusals that the caller can act on. The message says what was expected."""


class NotFoundError(ServiceError):
    """There is no such study, session, query or recording, or it belongs to another account."""


class GoneError(ServiceError):
    """The requested object existed and has been deleted."""


class StudyDeletedError(GoneError):
    """The study was deleted. way_back: the platform's return link for its participants."""

    def __init__(self, message: str, *, way_back: dict[str, Any] | None) -> None:
        super().__init__(message)
        self.way_back = way_back


class StoreAwayError(ServiceError):
    """The store of recordings does not respond or refuses. A retry may succeed."""


class SignInRequiredError(ServiceError):
    """The request has no token, or an unknown one."""


class TooManyError(ServiceError):
    """Too many requests of one kind. until: when the next one is accepted."""

    def __init__(self, message: str, until: datetime) -> None:
        super().__init__(message)
        self.until = until


class TooManyTriesError(TooManyError):
    """Too many failed sign-ins."""


class TooManyPasswordsError(TooManyError):
    """Too many passwords are waiting to be hashed."""


class TooManyBegunError(TooManyError):
    """Too many sessions of one study were begun and not continued."""


class SessionExpiredError(ServiceError):
    """The session's token has expired."""


class SessionTooOldError(SessionExpiredError):
    """The session was idle for longer than its study allows. policy: what happens to it then."""

    def __init__(self, message: str, policy: str) -> None:
        super().__init__(message)
        self.policy = policy


class ForbiddenError(ServiceError):
    """The caller is authenticated but not allowed to do this."""


class EntryLinkError(ForbiddenError):
    """The study requires single-use entry links, and this is not a valid one."""

    def __init__(self, message: str, *, is_used: bool) -> None:
        super().__init__(message)
        self.is_used = is_used


class SignedLinkError(ForbiddenError):
    """The study requires links signed by the platform, and this one is not validly signed."""


class UndeclaredIdentifierError(ServiceError):
    """An identifier has a key that the study's plan does not declare."""


class IdsRefusedError(ServiceError):
    """A platform's URL parameter has two values or is too long."""


class InvitationError(ServiceError):
    """The link to choose a password is used, expired or unknown."""


class StudyNotOpenError(ServiceError):
    """The study is not open to participants: not yet, if it `is_draft`, or no longer."""

    def __init__(self, message: str, *, is_draft: bool) -> None:
        super().__init__(message)
        self.is_draft = is_draft


class StudyPausedError(StudyNotOpenError):
    """The study is paused for new participants; running sessions continue."""

    def __init__(self, message: str) -> None:
        super().__init__(message, is_draft=False)


class StudyFullError(ServiceError):
    """The study has reached its number of participants."""


class ConflictError(ServiceError):
    """The operation is not possible in the present state."""


class PdfError(ConflictError):
    """A report cannot be made as PDF; the HTML of the same report can."""


class NoRoomError(ConflictError):
    """The disk or the account's quota has too little free space."""


class ChangedMeanwhileError(ConflictError):
    """Another request has changed the data since the form was loaded; nothing was stored."""


class SlugTakenError(ConflictError):
    """Another study has the slug, and it does not match the one being stored."""


class AlreadyTakenPartError(ConflictError):
    """The study admits each person once. way_back: return link of the person's earlier session."""

    def __init__(self, message: str, *, is_over: bool, way_back: dict[str, Any] | None) -> None:
        super().__init__(message)
        self.is_over = is_over
        self.way_back = way_back


class KnownPersonError(ConflictError):
    """A session with this platform id exists already, and the id alone does not prove identity.

    may_resume: whether the request also has that session's submission id, so that the participant
    may resume the session after confirming.
    """

    def __init__(self, message: str, *, may_resume: bool) -> None:
        super().__init__(message)
        self.may_resume = may_resume


class LeaseLostError(ConflictError):
    """A machine reports on a rollout that it does not hold any more."""


class OtherBytesError(ConflictError):
    """A machine sends another recording of a rollout that it has already recorded."""


class UploadOffsetError(ConflictError):
    """A part of an upload does not continue what has arrived. received: bytes that have."""

    def __init__(self, message: str, received: int) -> None:
        super().__init__(message)
        self.received = received


class RecordingRefusedError(ServiceError):
    """What a machine sent as a recording cannot be taken: no video, too large, or damaged."""


class RecordingTooLargeError(RecordingRefusedError):
    """A recording is larger than the settings allow; sending it again does not help."""


class ResponseRefusedError(ConflictError):
    """The response cannot be accepted. stage: the session's present stage."""

    def __init__(self, message: str, stage: str) -> None:
        super().__init__(message)
        self.stage = stage


class SkipReasonError(ResponseRefusedError):
    """The skip reason does not belong to this response."""


class TooLateToUndoError(ResponseRefusedError):
    """The response can no longer be undone, or the study does not offer undo."""


class SetAsideError(ResponseRefusedError):
    """The query was set aside for a technical fault and has been replaced."""


class NotRecordedYetError(ResponseRefusedError):
    """The query's videos do not exist yet: a machine records them."""


class NothingToShowError(ConflictError):
    """Fewer than two candidates of the study have an available video."""


class AlreadyAnsweredError(ResponseRefusedError):
    """The query already has a different response."""


class SkipNotOfferedError(ResponseRefusedError):
    """The query's condition does not offer a skip."""


class AnswersRefusedError(ServiceError):
    """The answers to a questionnaire are invalid. faults: one entry for each invalid answer."""

    def __init__(self, faults: tuple[AnswerFault, ...], stage: str) -> None:
        super().__init__("; ".join(f"{fault.item}: {fault.message}" for fault in faults))
        self.faults = faults
        self.stage = stage
