"""The modes of a session, which decide whether it counts and who may start it."""

from __future__ import annotations

#: A participant's session. Results leave out all other modes unless asked for them.
LIVE = "live"
#: An experimenter views the pages of evaluators.
PREVIEW = "preview"
#: A person tries the study by its pilot link, before it counts.
PILOT = "pilot"
#: A program responds on behalf of an experimenter.
SIMULATED = "simulated"

ALL = (LIVE, PREVIEW, PILOT, SIMULATED)
#: Modes in which a person responds.
OF_PEOPLE = (LIVE, PREVIEW, PILOT)
