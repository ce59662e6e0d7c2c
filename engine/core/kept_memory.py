"""Freed memory that a process keeps for its next arrays, in place of giving it back to the system each time."""

from __future__ import annotations

import ctypes
import os
import sys

MAX_KEPT_ARRAY_BYTES, MAX_KEPT_BYTES = 32 * 2**20, 256 * 2**20
"""Larger arrays are given back at once, and so is what would be kept beyond the second."""
_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1  # numbers of malloc.h


def keep_freed_memory() -> bool:
    """Let this process keep some of what it frees; whether the system's library could be told.

    The C library of Linux gives arrays of 128 kB and more back as they are freed, and each new one costs a page fault
    for every 4 kB. Elsewhere nothing is done. The environment's own settings (MALLOC_..., GLIBC_TUNABLES) go first.
    """
    set_already = any(name.startswith("MALLOC_") for name in os.environ) or "GLIBC_TUNABLES" in os.environ
    if not sys.platform.startswith("linux") or set_already:
        return False
    try:
        if not (os.confstr("CS_GNU_LIBC_VERSION") or "").startswith("glibc"):
            return False
        mallopt = ctypes.CDLL(None).mallopt
        sizes = {_MMAP_THRESHOLD: MAX_KEPT_ARRAY_BYTES, _TRIM_THRESHOLD: MAX_KEPT_BYTES}
        return all(mallopt(which, size) == 1 for which, size in sizes.items())
    except (OSError, AttributeError, ValueError):
        return False
