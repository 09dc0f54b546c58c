"""The ORM models, by subject.

All are imported together: tables refer to each other by name, and a process that imported only some
of them could not write to those.
"""

from . import accounts, arrivals, consents, records, rollouts, server_secrets, studies

__all__ = [
    "accounts",
    "arrivals",
    "consents",
    "records",
    "rollouts",
    "server_secrets",
    "studies",
]
