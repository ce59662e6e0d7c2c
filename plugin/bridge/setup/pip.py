"""pip in an environment that is being built: pinned packages with hashes, one after the other, then all at once."""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urljoin

from .problems import SetupError
from .requirements import Requirement

_MARKERS = """
import json, sys
from pip._vendor.packaging.markers import Marker
print(json.dumps([not text or Marker(text).evaluate() for text in json.loads(sys.argv[1])]))
"""
_INDEX = "https://pypi.org/simple"
_PIP = ("-I", "-m", "pip")
_KEPT_LINES = 400


@dataclass
class Pip:
    """``python`` is the environment's; ``run`` runs a command with an environment and passes on each line.

    ``wheels`` is where downloads are kept; ``source`` a folder of wheels that is used instead of the network;
    ``failed`` makes the error of what a child wrote; ``fetch`` gets a file from an address without pip.
    """

    python: Path
    run: Callable[[Sequence[str], Mapping[str, str], Callable[[str], None]], int]
    environ: Mapping[str, str]
    wheels: Path
    source: Path | None
    failed: Callable[[Sequence[str], str], SetupError]
    fetch: Callable[[str], bytes]
    _known: str = ""

    def start(self, installer: Requirement | None) -> None:
        """Put pip into the environment: that of Python, then exactly the ``installer`` of the lock.

        Debian's Python has no pip of its own without the package python3-venv; then pip's wheel installs itself.
        """
        task = "Installing pip"
        if installer is None:
            self._call(["-I", "-m", "ensurepip", "--upgrade", "--default-pip"], task)
            return
        program = list(_PIP)
        if self.run([str(self.python), "-I", "-m", "ensurepip", "--default-pip"], self.environ, lambda line: None):
            program = ["-I", str(self.kept(installer) or self._fetch(installer)) + "/pip"]
        elif self.version() == installer.version:
            return
        else:
            self.download(installer, lambda done, of: None)
        self.install([installer], self.python.parent, task, program=program)
        self._known = installer.version

    def _fetch(self, installer: Requirement) -> Path:
        """pip's own wheel, without pip."""
        name = f"pip-{installer.version}-py3-none-any.whl"
        self.wheels.mkdir(parents=True, exist_ok=True)
        if self.source is not None:
            content = (self.source / name).read_bytes()
        else:
            page = self.environ.get("PIP_INDEX_URL", _INDEX).rstrip("/") + "/pip/"
            links = re.findall(r'href="([^"#]+)', self.fetch(page).decode("utf-8", "replace"))
            link = next((link for link in links if link.endswith("/" + name)), name)
            content = self.fetch(urljoin(page, link))
        (self.wheels / name).write_bytes(content)
        file = self.kept(installer)
        if file is None:
            raise self.failed(["DO NOT MATCH THE HASHES"], "Downloading pip")
        return file

    def version(self) -> str:
        lines: list[str] = []
        self.run([str(self.python), "-I", "-m", "pip", "--version"], self.environ, lines.append)
        found = re.search(r"^pip (\S+)", "\n".join(lines), re.M)
        return found[1] if found else ""

    def applicable(self, requirements: Sequence[Requirement]) -> list[Requirement]:
        """Those that are for this system and this Python, by pip's own reading of the markers."""
        markers = json.dumps([one.marker for one in requirements])
        lines = self._call(["-I", "-c", _MARKERS, markers], "Reading the list of packages")
        return [one for one, wanted in zip(requirements, json.loads(lines[-1])) if wanted]

    def kept(self, requirement: Requirement) -> Path | None:
        """The file of a package that an earlier set-up downloaded, if it is whole; what is not is removed."""
        start = re.sub(r"[-_.]+", "_", requirement.name).lower() + "-"
        for path in sorted(self.wheels.glob("*.whl")):
            if path.name.lower().startswith(start) and path.name.split("-")[1] == requirement.version:
                if _sha256(path) in requirement.hashes:
                    return path
                path.unlink()
        return None

    def download(self, requirement: Requirement, progress: Callable[[int, int], None]) -> Path:
        """The checked file of a package; ``progress`` is called with the bytes that are there and all.

        Raises:
            NoWheelError: there is no build of it for this system.
        """
        file = self.kept(requirement)
        if file is not None:
            return file
        self.wheels.mkdir(parents=True, exist_ok=True)

        def take(line: str) -> None:
            found = re.fullmatch(r"Progress (\d+) of (\d+)", line)
            if found:
                progress(int(found[1]), int(found[2]))

        arguments = ["download", "--no-deps", "--dest", str(self.wheels), "--progress-bar", self._bar(), *self._from()]
        if requirement.index and self.source is None:
            arguments += ["--index-url", requirement.index]
        with self._listed([requirement], self.wheels) as listed:
            self._call([*_PIP, *arguments, *listed], f"Downloading {requirement.title}", take)
        file = self.kept(requirement)
        if file is None:
            raise SetupError(f"Downloading {requirement.title} left no whole file; set the engine up again.")
        return file

    def install(
        self,
        requirements: Sequence[Requirement],
        place: Path,
        task: str,
        target: Path | None = None,
        program: Sequence[str] = _PIP,
    ) -> None:
        """Install downloaded packages, without the network; ``place`` holds the list of them for pip."""
        arguments = ["install", "--no-deps", "--no-index", "--find-links", str(self.wheels), "--progress-bar", "off"]
        if target is not None:
            arguments += ["--target", str(target)]
        with self._listed(requirements, place) as listed:
            self._call([*program, *arguments, *listed], task)

    def _from(self) -> list[str]:
        return [] if self.source is None else ["--no-index", "--find-links", str(self.source)]

    def _bar(self) -> str:
        """Lines with bytes, where this pip has them."""
        self._known = self._known or self.version()
        major, minor = ([int(n) for n in re.findall(r"\d+", self._known)] + [0, 0])[:2]
        return "raw" if (major, minor) >= (24, 1) else "off"

    @contextlib.contextmanager
    def _listed(self, requirements: Sequence[Requirement], place: Path) -> Iterator[list[str]]:
        """pip's arguments for exactly these packages, each file checked by its hash."""
        path = place / "requirements.txt"
        path.write_text("".join(f"{one.text}\n" for one in requirements), encoding="utf-8")
        try:
            yield ["--require-hashes", "--only-binary", ":all:", "--requirement", str(path)]
        finally:
            path.unlink()

    def _call(self, arguments: Sequence[str], task: str, take: Callable[[str], None] = lambda line: None) -> list[str]:
        lines: list[str] = []

        def keep(line: str) -> None:
            lines.append(line)
            del lines[:-_KEPT_LINES]
            take(line)

        if self.run([str(self.python), *arguments], self.environ, keep):
            raise self.failed(lines, task)
        return lines


def _sha256(path: Path) -> str:
    found = hashlib.sha256()
    with path.open("rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            found.update(block)
    return found.hexdigest()
