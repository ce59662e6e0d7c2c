"""What every build of the set-up uses: children with a log, pip, room on the disk, folders that go as a whole."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import time
import urllib.error
import urllib.request
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from . import places, requirements, state
from .children import run_child
from .network import without_passwords
from .pip import Pip
from .problems import NoWheelError, SetupError, of_output
from .requirements import Requirement

ENGINE_BYTES, SCREENING_BYTES = 1_500_000_000, 1_300_000_000
"""Room that a build takes on the disk at its largest: downloads and what is installed from them."""
SCREENING_PATH = "slopewatch_screening.pth"
"""The file among the environment's packages that leads to those of the screening's network."""
_REMOVED = "removed-"


@dataclass(frozen=True)
class Order:
    """What to build, and from what.

    Attributes:
        root: the data folder. plugin: the plugin's folder, whose code the engine runs. version: the plugin's.
        pythons: commands that may start a Python, in order, each with where it was looked for.
        environ: of the engine's processes. pip_environ: of pip.
        screening: with the network's packages, too. repair: build anew what stands.
        wheels: a folder with all wheels, instead of the network.
        engine_bytes, screening_bytes: room that must be free on the disk.
    """

    root: Path
    plugin: Path
    version: str
    pythons: Sequence[tuple[tuple[str, ...], str]]
    environ: Mapping[str, str]
    pip_environ: Mapping[str, str]
    screening: bool = False
    repair: bool = False
    wheels: Path | None = None
    engine_lock: Path = requirements.ENGINE_LOCK
    screening_lock: Path = requirements.SCREENING_LOCK
    engine_bytes: int = ENGINE_BYTES
    screening_bytes: int = SCREENING_BYTES


@dataclass
class Reporter:
    """Where the set-up says what it does. ``progress`` takes percent and words; ``cancelled`` is asked often."""

    progress: Callable[[float, str], None] = lambda percent, words: None
    info: Callable[[str], None] = lambda words: None
    warn: Callable[[str], None] = lambda words: None
    cancelled: Callable[[], bool] = lambda: False


@dataclass
class Workshop:
    """An order at work. ``tick`` is called ten times a second while a child runs."""

    order: Order
    report: Reporter
    log: TextIO
    tick: Callable[[], None] = field(default=lambda: None)

    def run(
        self,
        command: Sequence[str],
        lines: list[str],
        environ: Mapping[str, str] | None = None,
        take: Callable[[str], None] = lambda line: None,
    ) -> int:
        """Run a child to its end: its code; its lines go to ``lines``, to ``take`` and to the log."""
        self.note("$ " + " ".join(command)[:1000])

        def keep(line: str) -> None:
            if not line.startswith("Progress "):
                self.note(line)
                lines.append(line)
            take(line)

        def cancelled() -> bool:
            self.tick()
            return self.report.cancelled()

        return run_child(command, self.order.environ if environ is None else environ, keep, cancelled)

    def failed(self, lines: Sequence[str], task: str) -> SetupError:
        """The error for a child that failed."""
        return of_output(lines, task, self.order.root, room(self.order.engine_bytes))

    # --- packages -----------------------------------------------------------------------------------------------

    def pip(self, environment: Path, tag: str) -> Pip:
        """pip of an environment; downloads for ``tag`` are kept together."""

        def run(command: Sequence[str], environ: Mapping[str, str], take: Callable[[str], None]) -> int:
            return self.run(command, [], environ, take)

        return Pip(
            python=self.interpreter(environment),
            run=run,
            environ=self.order.pip_environ,
            wheels=self.order.root / places.DOWNLOADS / tag,
            source=self.order.wheels,
            failed=self.failed,
            fetch=self._fetch,
        )

    def download(
        self, pip: Pip, wanted: Sequence[Requirement], start: float, end: float
    ) -> tuple[list[Requirement], tuple[str, ...]]:
        """Those packages that could be had; and the names of the optional ones that have no build.

        Args:
            start, end: percent of the whole set-up.
        """
        had, missing = [], []
        step = (end - start) / max(len(wanted), 1)
        for number, one in enumerate(wanted):
            words = f"Downloading {one.title} ({number + 1} of {len(wanted)})"
            low = start + number * step
            self.report.progress(low, words)

            def progress(done: int, of: int, low: float = low, words: str = words) -> None:
                share = done / of if of else 0.0
                size = f": {done / 1e6:.0f} of {of / 1e6:.0f} MB" if of > 2e6 else ""
                self.report.progress(low + step * share, words + size)

            try:
                pip.download(one, progress)
                had.append(one)
            except NoWheelError as error:
                if one.name not in requirements.OPTIONAL:
                    raise
                missing.append(one.name)
                self.report.warn(str(error))
        return had, tuple(missing)

    @contextlib.contextmanager
    def counted(self, packages: Path, count: int, start: float, end: float) -> Iterator[None]:
        """Progress while pip installs, by the packages that are there."""
        looked = 0.0

        def tick() -> None:
            nonlocal looked
            if time.monotonic() - looked < 0.5:
                return
            looked = time.monotonic()
            there = min(count, sum(1 for _ in packages.glob("*.dist-info")))
            percent = start + (end - start) * there / max(count, 1)
            self.report.progress(percent, f"Installing packages ({there} of {count})")

        self.tick = tick
        try:
            yield
        finally:
            self.tick = lambda: None

    def _fetch(self, address: str) -> bytes:
        """A file from the network, without pip, by the same proxy."""
        given = {name.upper(): value for name, value in self.order.pip_environ.items()}
        proxies = {
            kind: given[f"{kind.upper()}_PROXY"] for kind in ("http", "https") if f"{kind.upper()}_PROXY" in given
        }
        opener = urllib.request.build_opener(urllib.request.ProxyHandler(proxies))
        try:
            with opener.open(address, timeout=30) as answer:
                return bytes(answer.read())
        except (OSError, urllib.error.URLError) as error:
            raise self.failed([f"{error} Max retries exceeded"], "Downloading pip") from None

    # --- folders ------------------------------------------------------------------------------------------------

    def interpreter(self, environment: Path) -> Path:
        return Path(places.interpreter_in(environment, sys.platform))

    def packages(self, environment: Path, version: str) -> Path:
        return Path(places.packages_in(environment, sys.platform, version))

    def use(self, made: state.State) -> None:
        """From now on ``made`` is in use."""
        root = self.order.root
        if made.screening:
            packages = self.packages(root / made.environment, made.python)
            # relative, as the data folder may be moved
            there = os.path.relpath(root / made.screening, packages)
            (packages / SCREENING_PATH).write_text(f"{there}\n", encoding="utf-8")
        state.write(root, made)

    def ask_for_room(self, wanted: int) -> None:
        """Refuse to begin what the disk has no room for."""
        free = shutil.disk_usage(self.order.root).free
        if free < wanted:
            raise of_output(["Errno 28"], "", self.order.root, f"{room(wanted)} (there are {room(free)})")

    def clear_leftovers(self, kept: state.State | None) -> None:
        """Remove what an earlier set-up left when it was killed, and what is no longer in use."""
        names = {kept.environment, kept.screening} if kept else set()
        for place in list(self.order.root.iterdir()):
            if place.name.startswith((places.ENVIRONMENT, places.SCREENING, _REMOVED)) and place.name not in names:
                self.remove(place)

    def remove(self, folder: Path) -> None:
        """Remove a folder whole or not at all: on Windows one in which a program runs cannot be renamed, and stays."""
        if not folder.exists():
            return
        with contextlib.suppress(OSError):
            gone = folder.with_name(f"{_REMOVED}{uuid.uuid4().hex[:10]}")
            folder.rename(gone)
            shutil.rmtree(gone, ignore_errors=True)

    # --- words --------------------------------------------------------------------------------------------------

    def say(self, words: str) -> None:
        self.note(words)
        self.report.info(words)

    def note(self, line: str) -> None:
        """A line of the log."""
        self.log.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {without_passwords(line)}\n")
        self.log.flush()


def room(number: int) -> str:
    """Bytes, in words."""
    return f"{number / 1e9:.1f} GB"
