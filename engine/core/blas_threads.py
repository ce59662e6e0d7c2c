"""How many threads the libraries of linear algebra take; asked of the system once, which takes ten milliseconds."""

from __future__ import annotations

import functools
from contextlib import AbstractContextManager

from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager[object]:
    """Libraries of linear algebra that were loaded when this was first called work on one thread within the block."""
    return _libraries().limit(limits=1, user_api="blas")


@functools.cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()
