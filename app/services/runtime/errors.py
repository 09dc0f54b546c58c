"""What a use case may refuse. The edge turns each into one HTTP status, in one table."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from app.study.questionnaire import AnswerFault


class ServiceError(Exception):
    """A refusal that its caller can do something about; the message says what was expected."""


class NotFoundError(ServiceError):
    """There is no such study, session, query or recording, or it is not the caller's."""


class GoneError(ServiceError):
    """What was asked for was there, and is deleted."""


class StudyDeletedError(GoneError):
    """The study was deleted. `way_back` is for those who were in it."""

    def __init__(self, message: str, *, way_back: dict[str, Any] | None) -> None:
        super().__init__(message)
        self.way_back = way_back


class StoreAwayError(ServiceError):
    """The store of recordings gives no answer, or refuses: the same again may succeed later."""


class SignInRequiredError(ServiceError):
    """No token came, or one that nobody was given."""


class TooManyError(ServiceError):
    """Something was asked for too often; `until` says when it may be asked for again."""

    def __init__(self, message: str, until: datetime) -> None:
        super().__init__(message)
        self.until = until


class TooManyTriesError(TooManyError):
    """Passwords were tried too often."""


class TooManyPasswordsError(TooManyError):
    """More passwords came at once than are looked at."""


class TooManyBegunError(TooManyError):
    """More sessions of one study were begun, and not gone on with, than people would begin."""


class SessionExpiredError(ServiceError):
    """The session's token was good once."""


class SessionTooOldError(SessionExpiredError):
    """The session was left for longer than its study lets one resume it; `policy` says what now."""

    def __init__(self, message: str, policy: str) -> None:
        super().__init__(message)
        self.policy = policy


class ForbiddenError(ServiceError):
    """The caller is known, and may not do this."""


class EntryLinkError(ForbiddenError):
    """The study lets people in by links of their own, and this is none that lets one in."""

    def __init__(self, message: str, *, is_used: bool) -> None:
        super().__init__(message)
        self.is_used = is_used


class SignedLinkError(ForbiddenError):
    """The study lets people in by links that their platform signed, and this is none."""


class UndeclaredIdentifierError(ServiceError):
    """An identifier of a participant came under a key that the study's plan does not declare."""


class IdsRefusedError(ServiceError):
    """A platform's parameters that cannot be read: one has two values, or is too long."""


class InvitationError(ServiceError):
    """The link to choose a password with lets nobody do so: used, too old, or unknown."""


class StudyNotOpenError(ServiceError):
    """The study takes no participants now: not yet, if it `is_draft`, or no more."""

    def __init__(self, message: str, *, is_draft: bool) -> None:
        super().__init__(message)
        self.is_draft = is_draft


class StudyPausedError(StudyNotOpenError):
    """The study lets nobody in for a while; whoever is in it goes on."""

    def __init__(self, message: str) -> None:
        super().__init__(message, is_draft=False)


class StudyFullError(ServiceError):
    """All places of the study are taken."""


class ConflictError(ServiceError):
    """It cannot be done in the state that things are in."""


class NoRoomError(ConflictError):
    """A disk, or an account's share of it, has no room for what was sent or asked for."""


class ChangedMeanwhileError(ConflictError):
    """What a form was filled from has been changed by someone else; nothing was stored."""


class SlugTakenError(ConflictError):
    """Another study has the slug, and nothing shows that it is the same one."""


class AlreadyTakenPartError(ConflictError):
    """The study takes each person once. `way_back` is that of the session the person has had."""

    def __init__(self, message: str, *, is_over: bool, way_back: dict[str, Any] | None) -> None:
        super().__init__(message)
        self.is_over = is_over
        self.way_back = way_back


class KnownPersonError(ConflictError):
    """Somebody of this platform's id has begun already, and an id alone proves nothing.

    may_resume: whether the request also names the submission of that session, so that a press of
    its person leads back into it.
    """

    def __init__(self, message: str, *, may_resume: bool) -> None:
        super().__init__(message)
        self.may_resume = may_resume


class ResponseRefusedError(ConflictError):
    """A response that cannot be taken; `stage` is where the session is."""

    def __init__(self, message: str, stage: str) -> None:
        super().__init__(message)
        self.stage = stage


class SkipReasonError(ResponseRefusedError):
    """The reason is none that goes with this response."""


class TooLateToUndoError(ResponseRefusedError):
    """The response can no longer be taken back, or the study offers no such thing."""


class SetAsideError(ResponseRefusedError):
    """The query was set aside for a technical fault, and another one took its place."""


class NothingToShowError(ConflictError):
    """Hardly any video of the study can be had."""


class AlreadyAnsweredError(ResponseRefusedError):
    """The query has another response already."""


class SkipNotOfferedError(ResponseRefusedError):
    """The query's condition has no skip."""


class AnswersRefusedError(ServiceError):
    """Answers to a questionnaire that cannot be taken; `faults` names every one."""

    def __init__(self, faults: tuple[AnswerFault, ...], stage: str) -> None:
        super().__init__("; ".join(f"{fault.item}: {fault.message}" for fault in faults))
        self.faults = faults
        self.stage = stage
