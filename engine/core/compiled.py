"""Loops that numba compiles where it is installed, and numpy does otherwise.

A kernel is written twice: as a loop, and as numpy's plain way with the same result, bit for bit. numba is imported and
the loop compiled when it is first called, so that a command without kernels pays nothing. What was compiled is kept:
beside the module, or in the user's cache folder where that cannot be written; where neither can, the plain way is
taken, because compiling takes longer than a kernel saves. NUMBA_CACHE_DIR names another folder, NUMBA_DISABLE_JIT=1
takes the plain way.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from typing import Generic, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_LOCK = threading.Lock()


class Kernel(Generic[P, R]):
    """A function in two ways with the same result: ``loop``, to be compiled, and ``plain``, by numpy."""

    def __init__(self, loop: Callable[P, R], plain: Callable[P, R]) -> None:
        self.loop, self.plain = loop, plain
        self.__doc__ = loop.__doc__
        self._chosen: Callable[P, R] | None = None

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Compute it, compiled where that is possible."""
        if self._chosen is None:
            with _LOCK:
                self._chosen = compiled_loop(self.loop) or self.plain
        return self._chosen(*args, **kwargs)


def compiled(plain: Callable[P, R]) -> Callable[[Callable[P, R]], Kernel[P, R]]:
    """Decorator of a loop over arrays that numba can compile; ``plain`` is taken where it cannot.

    The loop calls nothing but numpy and its own module's constants, gets arrays and numbers of the same types in each
    call, and checks its indices itself: a compiled loop reads beyond an array without an error. It runs without
    Python's lock.
    """

    def decorate(loop: Callable[P, R]) -> Kernel[P, R]:
        return Kernel(loop, plain)

    return decorate


def compiled_loop(loop: Callable[P, R]) -> Callable[P, R] | None:
    """The loop, to be compiled with its first call or taken from what was kept; None where that cannot be."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return None
    try:
        import numba
    except ImportError:
        return None
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy")(loop)
    except RuntimeError:  # numba found no folder to keep it in
        return None
