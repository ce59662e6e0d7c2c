"""Starts one command and measures it; standard library only, so that it stays small.

Linux carries the peak memory of the process that starts a program into the program's own figure. A benchmark that holds
clouds would so be measured with every child; this small process in between is not.

``python -I -S child_launcher.py`` reads one JSON object from standard input: command, environment, cwd, log,
limit_bytes and limit_s (either may be null); and prints one. Standard output goes to log, errors to log + ".errors".
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time

LOOK_S, SAMPLE_S = 0.02, 0.5
PAGE = os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    """Measure the command that standard input names."""
    asked = json.load(sys.stdin)
    with open(asked["log"], "wb") as log, open(asked["log"] + ".errors", "wb") as errors:
        started = time.monotonic()
        child = subprocess.Popen(
            asked["command"],
            env=asked["environment"],
            cwd=asked["cwd"],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=errors,
        )
        together, stopped, due = 0, "", 0.0
        while True:
            done, status, used = os.wait4(child.pid, os.WNOHANG)
            if done:
                break
            # looking through all processes takes milliseconds, so it is done seldom
            if time.monotonic() >= due:
                due = time.monotonic() + SAMPLE_S
                family = descendants(child.pid)
                held = sum(resident(pid) for pid in family)
                together = max(together, held)
                stopped = stopped or reason(asked, held, time.monotonic() - started)
                for pid in family if stopped else ():
                    end(pid)
            time.sleep(LOOK_S)
        seconds = time.monotonic() - started
    print(
        json.dumps(
            {
                "seconds": seconds,
                "cpu": used.ru_utime + used.ru_stime,
                "peak": used.ru_maxrss * 1024,
                "together": max(together, used.ru_maxrss * 1024),
                "code": os.waitstatus_to_exitcode(status),
                "stopped": stopped,
            }
        )
    )


def reason(asked: dict, held: int, seconds: float) -> str:
    """Why the child must end, an empty text where it may go on."""
    if asked["limit_bytes"] is not None and held > asked["limit_bytes"]:
        return "memory"
    return "time" if asked["limit_s"] is not None and seconds > asked["limit_s"] else ""


def descendants(root: int) -> list[int]:
    """A process and all that it started, directly or not."""
    parents = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                with open(f"/proc/{name}/stat", "rb") as file:
                    # the program's name, in brackets, may hold spaces
                    parents[int(name)] = int(file.read().rpartition(b")")[2].split()[1])
            except (OSError, IndexError):
                continue
    found = [root]
    for pid in found:
        found += [child for child, parent in parents.items() if parent == pid]
    return found


def resident(pid: int) -> int:
    """Bytes of memory that a process holds now; 0 where it has ended."""
    try:
        with open(f"/proc/{pid}/statm", "rb") as file:
            return int(file.read().split()[1]) * PAGE
    except (OSError, IndexError):
        return 0


def end(pid: int) -> None:
    """Kill a process that may have ended."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


if __name__ == "__main__":
    main()
