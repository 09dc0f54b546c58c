"""The states of a rollout, as stored in `rollouts.status`.

`asked` and `claimed` are outstanding. A claimed rollout whose lease has ended, or whose attempt has
failed, is asked again while attempts remain. `withdrawn` follows `recorded` only.
"""

from __future__ import annotations

from typing import Final

ASKED: Final = "asked"
CLAIMED: Final = "claimed"
RECORDED: Final = "recorded"
FAILED: Final = "failed"
UNSAFE: Final = "unsafe"
CANCELLED: Final = "cancelled"
WITHDRAWN: Final = "withdrawn"

#: A query that waits for a rollout in one of these states waits in vain.
LOST: Final = (FAILED, UNSAFE, CANCELLED, WITHDRAWN)
