"""How the engine speaks to the process that started it: one JSON object a line on standard output, and exit codes.

Each object has the key ``event``. ``progress`` has ``percent`` and ``message``; ``log`` has ``level`` and ``message``;
``result`` has ``outputs`` (name to path), ``metrics`` and ``conclusion`` (sentences); ``error`` has ``message`` and
``code``.
"""

from __future__ import annotations

PROGRESS, LOG, RESULT, ERROR = "progress", "log", "result", "error"
"""The values of ``event``."""

DONE = 0
INTERNAL_FAILURE = 1
INPUT_REFUSED = 2
"""Something given cannot be used; the message says what, and the remedy."""
SOME_FAILED = 3
"""The results of a batch exist, but some of its slopes have none."""
CANCELLED = 130

TASK_VARIABLE = "SLOPEWATCH_TASK"
"""Environment variable: the id under which a batch started this run; it becomes ``task`` in the run record."""
