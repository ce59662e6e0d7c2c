"""Loops that numba compiles where it is installed, and numpy does otherwise.

A kernel is written twice: as a loop, and as numpy's plain way with the same result, bit for bit. numba is imported and
the loop compiled when it is first called, so that a command without kernels pays nothing. What was compiled is kept:
beside the module, or in the user's cache folder where that cannot be written; where neither can, the plain way is
taken, because compiling takes longer than a kernel saves. NUMBA_CACHE_DIR names another folder, NUMBA_DISABLE_JIT=1
takes the plain way.
"""

from __future__ import annotations

import importlib.util
import os
import threading
from collections.abc import Callable
from types import FunctionType
from typing import Any, Generic, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_LOCK = threading.Lock()
_HELPER: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True
}  # fmt: skip
_AT_WORK = threading.Event()  # numba has been imported and made ready by a kernel


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


class Loop(Generic[P, R]):
    """A function over arrays to be compiled, whose callers have a way of their own where that cannot be."""

    def __init__(self, loop: Callable[P, R], *helpers: Callable[..., Any]) -> None:
        """``helpers`` as in ``compiled``."""
        loop.__dict__["helpers"] = helpers
        self.loop = loop
        self._ready: list[Callable[P, R] | None] = []

    def ready(self) -> Callable[P, R] | None:
        """The compiled function; None where it cannot be compiled."""
        with _LOCK:
            if not self._ready:
                self._ready.append(compiled_loop(self.loop))
            return self._ready[0]


def compiled(plain: Callable[P, R], *helpers: Callable[..., Any]) -> Callable[[Callable[P, R]], Kernel[P, R]]:
    """Decorator of a loop over arrays that numba can compile; ``plain`` is taken where it cannot.

    The loop calls nothing but numpy, its own module's constants and ``helpers``, gets arrays and numbers of the same
    types in each call, and checks its indices itself: a compiled loop reads beyond an array without an error. It runs
    without Python's lock.

    Args:
        helpers: functions of the loop's module that it, or one of them before it, calls, written as a loop is; what
            is kept of a loop is made anew when its own module changes only.
    """

    def decorate(loop: Callable[P, R]) -> Kernel[P, R]:
        loop.__dict__["helpers"] = helpers
        return Kernel(loop, plain)

    return decorate


def pays(work: int, least: int) -> bool:
    """Whether a kernel is faster than numpy's way for an amount of ``work``, of which ``least`` is worth loading numba.

    That takes half a second of a processor once for a process; where a kernel has done it already, any work pays.
    """
    return _AT_WORK.is_set() or (work >= least and _available())


def take_kernels() -> None:
    """Let kernels count as loaded where numba is there, as after a registration, for whatever is computed next."""
    if _available():
        _AT_WORK.set()


def _available() -> bool:
    return not _refused() and importlib.util.find_spec("numba") is not None


def _refused() -> bool:
    return os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


def compiled_loop(loop: Callable[P, R]) -> Callable[P, R] | None:
    """The loop, to be compiled with its first call or taken from what was kept; None where that cannot be."""
    if _refused():
        return None
    try:
        import numba
    except ImportError:
        return None
    known: dict[str, Any] = {}
    for helper in loop.__dict__.get("helpers", ()):
        known[helper.__name__] = numba.njit(**_HELPER)(_knowing(helper, known))
    try:
        ready: Callable[P, R] = numba.njit(cache=True, nogil=True, error_model="numpy")(_knowing(loop, known))
    except RuntimeError:  # numba found no folder to keep it in
        return None
    _AT_WORK.set()
    return ready


def _knowing(function: Callable[P, R], known: dict[str, Any]) -> Callable[P, R]:
    """The function with other values of some names of its module."""
    if not known:
        return function
    assert isinstance(function, FunctionType)
    other = FunctionType(function.__code__, function.__globals__ | known, function.__name__, function.__defaults__)
    other.__module__, other.__qualname__ = function.__module__, function.__qualname__
    return other
