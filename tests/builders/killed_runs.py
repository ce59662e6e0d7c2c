"""A run that is killed while it gives its files their names."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from slopewatch.engine.core.journal import DONE
from slopewatch.engine.core.staged_outputs import staged_outputs

KILLED = 77


def killed_before_done(work: Callable[[], object]) -> None:
    """Do ``work`` in a fork that ends, without any clean-up, before the rename that makes its results the new ones."""
    child = os.fork()
    if child == 0:
        move = os.replace

        def before_done(source: str, target: str) -> None:
            if os.path.basename(target) == DONE:
                os._exit(KILLED)
            move(source, target)

        os.replace = before_done  # type: ignore[assignment]
        try:
            work()
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == KILLED


def half_replaced(folder: Path, names: tuple[str, ...]) -> None:
    """Files of these names that were "old", and are "new" until somebody looks at the folder."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("old")

    def work() -> None:
        with staged_outputs(folder) as stage:
            for name in names:
                stage.path(name).write_text("new")

    killed_before_done(work)
