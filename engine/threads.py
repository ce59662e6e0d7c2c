"""Work on several cores at once, of the kind that leaves Python's lock to others: long sums over arrays."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")


def side_by_side(*tasks: Callable[[], Result]) -> list[Result]:
    """What each of ``tasks`` returns, in their order, whichever ends first; the first error among them is raised."""
    with ThreadPoolExecutor(len(tasks)) as pool:
        return [running.result() for running in [pool.submit(task) for task in tasks]]
