"""How much memory this machine has for one command."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

_CGROUP_LIMITS = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))
_UNKNOWN_BYTES = 8_000_000_000
"""Assumed where the system does not say."""


def machine_memory() -> int:
    """Bytes of memory that this process can have: the machine's, or its container's where that has less."""
    limits = [_installed(), *(_limit(path) for path in _CGROUP_LIMITS)]
    known = [limit for limit in limits if limit]
    return min(known, default=_UNKNOWN_BYTES)


def _installed() -> int:
    if hasattr(os, "sysconf"):
        try:
            return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        except (OSError, ValueError):
            return 0
    return _installed_on_windows()


def _limit(path: Path) -> int:
    """Bytes that a control group may take; 0 where it is not limited."""
    try:
        text = path.read_text().strip()
        return int(text) if text.isdigit() else 0
    except OSError:
        return 0


def _installed_on_windows() -> int:
    class Status(ctypes.Structure):
        _fields_ = [("length", ctypes.c_ulong), ("load", ctypes.c_ulong)] + [
            (name, ctypes.c_ulonglong)
            for name in ("total", "free", "paged", "free_paged", "space", "free_space", "more")
        ]

    status = Status()
    status.length = ctypes.sizeof(Status)
    library = getattr(ctypes, "windll", None)
    return int(status.total) if library and library.kernel32.GlobalMemoryStatusEx(ctypes.byref(status)) else 0
