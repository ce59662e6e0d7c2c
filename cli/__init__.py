"""The command line: ``slopewatch COMMAND``."""

from __future__ import annotations

import gc
import os
import signal
import sys

from ..engine.core.kept_memory import keep_freed_memory
from ..interface.protocol import CANCELLED

_COLLECTED_AFTER = 100_000, 20, 100
"""New objects after which Python looks for circles among them, and how often it then looks at older and at all ones.

Libraries leave some 400,000 objects behind, which the usual 700 new ones have it look through again and again.
"""


def main() -> None:
    gc.set_threshold(*_COLLECTED_AFTER)
    keep_freed_memory()
    # until the command itself listens (see cancellation.install) there is nothing to clean up
    for name in ("SIGINT", "SIGTERM"):
        signal.signal(getattr(signal, name), _leave)
    from .program import cli

    cli()


def _leave(*_: object) -> None:
    sys.stderr.write("Cancelled.\n")
    sys.stderr.flush()
    os._exit(CANCELLED)
