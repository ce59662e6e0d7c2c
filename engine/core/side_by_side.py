"""Work in threads, where its loops do not hold Python's lock (``compiled``)."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from .processors import processors

R = TypeVar("R")


def side_by_side(*work: Callable[[], R]) -> list[R]:
    """What each of ``work`` gives, on as many processors as there are; of several that fail the first one's error."""
    if min(processors(), len(work)) < 2:
        return [one() for one in work]
    with ThreadPoolExecutor(min(processors(), len(work))) as pool:
        return [started.result() for started in [pool.submit(one) for one in work]]
