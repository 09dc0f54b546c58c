"""The rules of a study: its folder and plan, the protocol of a session, and who gets which order.

Pure: no web, no database, no clock; a study folder is read from disk, and nothing else is.
"""

from .assignment import choose_order, orders, plan_orders, sample_familiarisation, trial_conditions
from .environments import Environment
from .folder import SHIPPED, TEXT_NAMES, StudyFolder, UnknownStudyError, load, resolve
from .markdown import consent_version, render
from .plan import Condition, Plan, plan_hash
from .plan_validation import METHODS, Method
from .questionnaire import AnswerFault, Item, Questionnaires, read_answers
from .recordings import RecordingRow
from .scaffold import FolderNotEmptyError, init
from .search_space import Parameter
from .stage_settings import Device, DeviceCheck
from .stages import (
    Answered,
    BreakNotOver,
    Consented,
    Continued,
    DeviceRefused,
    Event,
    OutOfOrder,
    Position,
    Progress,
    ProtocolError,
    Responded,
    ScreenedOut,
    Stage,
    StaleConsent,
    WatchMore,
    Withdrew,
    advance,
    position,
)
from .validation_errors import Fault, StudyFaults

__all__ = [
    "METHODS",
    "SHIPPED",
    "TEXT_NAMES",
    "AnswerFault",
    "Answered",
    "BreakNotOver",
    "Condition",
    "Consented",
    "Continued",
    "Device",
    "DeviceCheck",
    "DeviceRefused",
    "Environment",
    "Event",
    "Fault",
    "FolderNotEmptyError",
    "Item",
    "Method",
    "OutOfOrder",
    "Parameter",
    "Plan",
    "Position",
    "Progress",
    "ProtocolError",
    "Questionnaires",
    "RecordingRow",
    "Responded",
    "ScreenedOut",
    "Stage",
    "StaleConsent",
    "StudyFaults",
    "StudyFolder",
    "UnknownStudyError",
    "WatchMore",
    "Withdrew",
    "advance",
    "choose_order",
    "consent_version",
    "init",
    "load",
    "orders",
    "plan_hash",
    "plan_orders",
    "position",
    "read_answers",
    "render",
    "resolve",
    "sample_familiarisation",
    "trial_conditions",
]
