"""The base model of a plan's parts, and the types of values that several of them have."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _require_text(value: object) -> object:
    """A text is a string, or one string per language; never empty."""
    texts = list(value.values()) if isinstance(value, Mapping) else [value]
    languages = list(value) if isinstance(value, Mapping) else []
    if not texts or not all(isinstance(text, str) and text.strip() for text in texts):
        raise ValueError("not a text")
    if not all(isinstance(language, str) for language in languages):
        raise ValueError("not a language")
    return value


LocalText = Annotated[str | dict[str, str], BeforeValidator(_require_text)]
ONE_OR_MORE_TEXTS = "a text, or one text per language such as {en: ..., ja: ...}"
#: A whole or broken number; no text, no truth value.
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]


def absent(value: object) -> bool:
    """Whether an optional value was not given."""
    return value is None


class Part(BaseModel):
    """A part of the plan: unknown keys are refused, and instances are immutable."""

    model_config = ConfigDict(frozen=True, extra="forbid")
