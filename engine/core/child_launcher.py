"""Become another program, with limits: ``python child_launcher.py PARENT BYTES PROGRAM [ARGUMENT ...]``.

What would otherwise run between fork and exec in a process with threads, where a lock that another thread held at the
fork (of the allocator, OpenMP, BLAS) can never be had again. Standard library only; POSIX.
"""

from __future__ import annotations

import os
import resource
import signal
import sys

_PR_SET_PDEATHSIG = 1


def main(parent: int, memory_limit: int, command: list[str]) -> None:
    """Die with ``parent``, take at most ``memory_limit`` bytes of address space (0: any), become ``command``."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it died before it could be watched
            os._exit(1)
    if memory_limit:
        resource.setrlimit(resource.RLIMIT_AS, (memory_limit, memory_limit))
    try:
        os.execvp(command[0], command)
    except OSError as error:
        sys.exit(f"{command[0]} cannot be started ({error.strerror})")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
