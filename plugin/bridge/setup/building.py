"""Builds the engine: a new environment next to the old one, checked, then named as the one in use in one step."""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ....interface.file_lock import Lock, attempt
from . import places, requirements, screening, shim, state
from .problems import SetupError, of_system
from .pythons import Found, in_order, none_found
from .workshop import Order, Reporter, Workshop, room

_CHECK = ("-m", "slopewatch.cli", "check", "--progress", "json")
_NEEDED_MODULES = "import ctypes, sqlite3, ssl, zlib"


def set_up(order: Order, report: Reporter) -> state.State:
    """Build what is missing or older than the plugin, and give what is in use then.

    Raises:
        SetupError: it could not be done. The engine that was there before is still in use, and no half-built one is
            left; what was downloaded is kept.
    """
    try:
        order.root.mkdir(parents=True, exist_ok=True)
        with attempt(order.root / places.LOCK) as lock:
            if lock is Lock.BUSY:
                raise SetupError(
                    f"Another QGIS is setting the engine up in {order.root}; try again when it has finished."
                )
            with (order.root / places.LOG).open("w", encoding="utf-8") as log:
                shop = Workshop(order, report, log)
                try:
                    return _build(shop)
                except Exception as error:
                    shop.note(f"{type(error).__name__}: {error}")
                    raise
    except OSError as error:
        raise of_system(error, order.root, room(order.engine_bytes)) from error


def _build(shop: Workshop) -> state.State:
    order = shop.order
    shop.note(f"SlopeWatch {order.version}, data folder {order.root}, plugin {order.plugin}")
    before = state.read(order.root)
    shop.clear_leftovers(before)
    ready = state.condition(order.root, order.engine_lock, order.version) is state.Condition.READY
    if before is None or order.repair or not ready:
        now = _engine(shop)
    else:
        now = replace(before, screening="", screening_lock="")
        shim.write(shop.packages(order.root / now.environment, now.python), order.plugin)
        shop.say("The engine stands already.")
    if order.screening or (before is not None and before.screening):
        if before is not None and not (order.repair and order.screening) and screening.serves(shop, before, now):
            now = replace(now, screening=before.screening, screening_lock=before.screening_lock)
            shop.use(now)
        else:
            now = screening.build(shop, now)
    shop.clear_leftovers(now)
    shop.remove(order.root / places.DOWNLOADS)
    shop.report.progress(100, "Done")
    return now


def _engine(shop: Workshop) -> state.State:
    """A new environment, in use."""
    order = shop.order
    shop.ask_for_room(order.engine_bytes)
    environment = order.root / f"{places.ENVIRONMENT}{uuid.uuid4().hex[:10]}"
    try:
        python = _new_environment(shop, environment)
        pip = shop.pip(environment, python.tag)
        shop.report.progress(3, "Installing pip")
        every = requirements.read_lock(order.engine_lock)
        installer = next((one for one in every if one.name == requirements.INSTALLER), None)
        pip.start(installer)
        wanted, missing = shop.download(pip, pip.applicable([one for one in every if one is not installer]), 5, 65)
        if "llvmlite" in missing:  # numba cannot do without it
            wanted = [one for one in wanted if one.name != "numba"]
        packages = shop.packages(environment, python.version)
        with shop.counted(packages, len(wanted), 65, 93):
            pip.install(wanted, environment, "Installing the engine's packages")
        shim.write(packages, order.plugin)
        shop.report.progress(93, "Checking the engine")
        _check(shop, environment)
        lock = state.digest(order.engine_lock)
        made = state.State(environment.name, lock, order.version, python.version, python.executable, missing)
        shop.use(made)
    except BaseException:
        shop.remove(environment)
        raise
    shop.say(f"The engine stands: Python {python.version}, {len(wanted)} packages, in {environment}.")
    return made


def _new_environment(shop: Workshop, environment: Path) -> Found:
    """An empty virtual environment of the first Python that can make one that works."""
    refused: list[str] = []

    def ask(command: Sequence[str]) -> str:
        lines: list[str] = []
        shop.run(command, lines)
        return "\n".join(lines)

    shop.report.progress(0, "Looking for a Python")
    for found in in_order(shop.order.pythons, ask, refused):
        shop.report.progress(1, f"Making an environment of Python {found.version}")
        lines: list[str] = []
        made = shop.run([found.executable, "-I", "-m", "venv", "--without-pip", str(environment)], lines)
        python = str(shop.interpreter(environment))
        # macOS's bundle makes environments that do not start
        if made == 0 and shop.run([python, "-I", "-c", _NEEDED_MODULES], lines) == 0:
            shop.say(f"The engine is made with Python {found.version}: {found.executable} ({found.how}).")
            return found
        shop.remove(environment)
        complaint = shop.failed(lines, "Making an environment")
        if "is full" in str(complaint) or "may not write" in str(complaint):
            raise complaint
        refused.append(f"Python {found.version} at {found.executable} cannot make an environment that works")
    raise none_found(refused)


def _check(shop: Workshop, environment: Path) -> None:
    """Let the engine import all of its libraries and say its version.

    SLOPEWATCH_PDAL=none: whether there is a PDAL does not decide whether the build is whole.
    """
    lines: list[str] = []
    order = shop.order
    variables = {**order.environ, shim.VARIABLE: str(order.plugin), "SLOPEWATCH_PDAL": "none"}
    if shop.run([str(shop.interpreter(environment)), *_CHECK], lines, variables):
        raise shop.failed(lines, "Checking the engine")
    if not any(f'"slopewatch": "{order.version}"' in line for line in lines):
        raise SetupError(
            f"The engine that was built does not say that it is SlopeWatch {order.version}; install the plugin again, "
            "and set the engine up again."
        )
