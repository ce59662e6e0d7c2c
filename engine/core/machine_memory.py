"""How much memory the machine, or the container that the engine runs in, has."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

_GROUP_LIMITS = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))
_UNKNOWN_BYTES = 8_000_000_000  # taken where the system does not tell


def machine_memory(limits: tuple[Path, ...] = _GROUP_LIMITS) -> int:
    """Bytes of memory of the machine, or of the container where that has less.

    Args:
        limits: files in which Linux states the limit of a container's memory (cgroup v2 and v1), if there is one.
    """
    known = [_physical(), *(_stated(path) for path in limits)]
    return min((size for size in known if size), default=_UNKNOWN_BYTES)


def _physical() -> int:
    """0 where the system does not tell."""
    if sys.platform == "win32":
        return _of_windows()
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (OSError, ValueError):
        return 0


def _stated(path: Path) -> int:
    """The number in a file; 0 without one, as where it says "max"."""
    try:
        return int(path.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return 0


def _of_windows() -> int:
    class Status(ctypes.Structure):
        """MEMORYSTATUSEX of the Windows API."""

        _fields_ = [("length", ctypes.c_uint32), ("load", ctypes.c_uint32)] + [
            (name, ctypes.c_uint64)
            for name in ("physical", "free", "pages", "free_pages", "virtual", "free_virtual", "extended")
        ]

    status = Status(length=ctypes.sizeof(Status))
    found = getattr(ctypes, "windll").kernel32.GlobalMemoryStatusEx(ctypes.byref(status))  # noqa: B009
    return int(status.physical) if found else 0
