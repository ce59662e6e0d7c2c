"""The command line: ``slopewatch COMMAND``."""

from __future__ import annotations

import os
import signal
import sys

from ..interface.protocol import CANCELLED


def main() -> None:
    # until the command itself listens (see cancellation.install) there is nothing to clean up
    for name in ("SIGINT", "SIGTERM"):
        signal.signal(getattr(signal, name), _leave)
    from .program import cli

    cli()


def _leave(*_: object) -> None:
    sys.stderr.write("Cancelled.\n")
    sys.stderr.flush()
    os._exit(CANCELLED)
