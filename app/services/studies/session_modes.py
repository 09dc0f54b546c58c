"""The modes of a session: whether it counts, and who may begin it."""

from __future__ import annotations

#: Takes part in the study. All others are left out of results unless asked for.
LIVE = "live"
#: An experimenter looks at the pages that evaluators will see.
PREVIEW = "preview"
#: Somebody tries the study by a link of its own, before it counts.
PILOT = "pilot"
#: A program answers, on an experimenter's behalf.
SIMULATED = "simulated"

ALL = (LIVE, PREVIEW, PILOT, SIMULATED)
#: Sessions in which a person answers.
OF_PEOPLE = (LIVE, PREVIEW, PILOT)
