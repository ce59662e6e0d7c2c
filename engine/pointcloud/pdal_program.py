"""PDAL: finding it, and running pipelines in a child process that can be cancelled.

Pipelines are lists of stages (dictionaries), as PDAL's documentation describes them: a reader, filters, and a writer
whose file appears only when the pipeline ended well.
"""

from __future__ import annotations

import copy
import functools
import importlib.util
import json
import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from ..core import child_process
from ..core.errors import EngineError, InputError
from ..core.messages import shown
from ..core.staged_outputs import atomic_output
from ..core.temporary_folders import temporary_folder
from .header import preflight
from .pdal_places import QGIS_VARIABLE, library_variables, pdal_places

VARIABLE = "SLOPEWATCH_PDAL"
NONE = "none"
"""The variable's value for doing without PDAL."""
CSF_SINCE = (2, 3)
"""PDAL 2.2's filters.csf fails on every cloud (https://github.com/PDAL/PDAL/issues/3463)."""
NO_CLASS_12_SINCE = (2, 4)
"""From then on points of formats 0 to 5 with class 12 are read as of class 0 with the overlap flag."""
PRIVATE = Path(__file__).resolve().parents[2] / ".pdal" / "bin" / "pdal"
_WORKER = Path(__file__).with_name("pdal_worker.py")
_UNSAFE = re.compile(r"[\[\]*?#\"\\\x00-\x1f\x7f]" if os.name == "posix" else r"[\[\]*?#\"\x00-\x1f\x7f]")
_START_S = 60.0  # to say its version, which takes 0.1 s
_BASE_TIME_S = 600.0
_TIME_PER_POINT_S = 200e-6
"""130 times what PDAL 2.2 takes to read, crop and write a point of a LAZ file (644,000 a processor second, 2026-11-24);
its cloth takes longer."""
Stage = dict[str, Any]


@dataclass(frozen=True)
class Pdal:
    """A PDAL that starts. ``path`` is the program, None for the Python package; ``how`` says where it was found.

    ``NO_PDAL``, without a version, stands for none.
    """

    path: Path | None
    version: str
    how: str

    @property
    def is_there(self) -> bool:
        return bool(self.version)

    @property
    def release(self) -> tuple[int, ...]:
        return _release(self.version)

    @property
    def has_csf(self) -> bool:
        """Whether its filters.csf works."""
        return self.release >= CSF_SINCE

    @property
    def drops_class_12(self) -> bool:
        """Whether it takes class 12 of point formats before 6 for a flag."""
        return self.release >= NO_CLASS_12_SINCE

    def _libraries(self) -> dict[str, str]:
        return {} if self.path is None else library_variables(sys.platform, self.path, os.environ, os.path.isfile)

    def run(
        self,
        pipeline: list[Stage],
        *,
        memory_limit: int | None = None,
        time_limit_s: float | None = None,
        cloud: Path | None = None,
    ) -> None:
        """Run a pipeline; its writer's file is complete or absent.

        Args:
            pipeline: stages, a reader first and a writer last, which name files as ``filename``.
            memory_limit: bytes of address space PDAL may take (where the system can limit it).
            time_limit_s: seconds it may take.
            cloud: the user's, for the sentence; by default what the pipeline reads.

        Raises:
            InputError: it took longer; the reader cannot read its file, or the output cannot be written.
            EngineError: PDAL failed otherwise.
        """
        with temporary_folder("pdal", needed_bytes=_written(pipeline)) as folder, _run_names(pipeline, folder) as safe:
            try:
                result = child_process.run_child(
                    [sys.executable, _WORKER] if self.path is None else [self.path, "pipeline", "--stdin"],
                    stdin=json.dumps({"pipeline": safe}).encode(),
                    memory_limit=memory_limit,
                    time_limit_s=time_limit_s,
                    # one thread: several give another cloth, and so other ground, from run to run
                    environment={**os.environ, **self._libraries(), "OMP_NUM_THREADS": "1"},
                    directory=folder,  # some releases leave files of the cloth where they run
                )
            except child_process.ChildTimeout as error:
                raise InputError(
                    f"PDAL {self.version} did not finish {shown(cloud or pipeline[0]['filename'])} within "
                    f"{(time_limit_s or 0) / 60:.0f} minutes; clip the cloud to a smaller area, or give another PDAL."
                ) from error
            if result.returncode:
                raise _failure(result, pipeline, self.version)


NO_PDAL = Pdal(None, "", "none was found")


def time_limit_s(points: int) -> float:
    """Seconds that PDAL may take for a cloud of so many points."""
    return _BASE_TIME_S + _TIME_PER_POINT_S * points


def keep_pipeline(pipeline: list[Stage], path: Path, final: Path | None = None) -> None:
    """Write a pipeline as JSON for ``pdal pipeline``: absolute names, with wildcards escaped as PDAL wants it.

    Args:
        final: folder in which the files next to ``path`` will be in the end, if another; the JSON names it.
    """
    folder = path.parent.absolute()
    kept = copy.deepcopy(pipeline)
    for stage in kept:
        if "filename" not in stage:
            continue
        file = Path(stage["filename"]).absolute()
        name = str((final or folder).absolute() / file.name if file.parent == folder else file)
        if str(stage["type"]).startswith("writers."):
            name = name.replace("#", "_")
        elif os.name == "posix":
            name = re.sub(r"[*?\[]", r"[\g<0>]", name)
        stage["filename"] = name
    with atomic_output(path) as temporary:
        temporary.write_text(json.dumps({"pipeline": kept}, indent=2) + "\n", encoding="utf-8")


def find_pdal(setting: Path | str | None = None) -> Pdal:
    """The PDAL to use: ``setting``, then SLOPEWATCH_PDAL, then the Python package, then what is found.

    Found is what came with QGIS, on PATH, in conda or in the private prefix; of these the newest is taken, the first
    of equals. ``NO_PDAL`` where there is none, or where the variable says ``NONE``.

    Raises:
        InputError: the one asked for does not start.
    """
    names = ("PATH", QGIS_VARIABLE, "CONDA_PREFIX")
    return _find(os.environ.get(VARIABLE, ""), str(setting or ""), *(os.environ.get(name, "") for name in names))


@functools.lru_cache(maxsize=8)
def _find(variable: str, setting: str, search_path: str, qgis: str, conda: str) -> Pdal:
    """``find_pdal`` in an environment, of which those three variables decide."""
    for given, how, remedy in (
        (setting, "setting", "correct the setting (--pdal)"),
        (variable, f"environment variable {VARIABLE}", f"correct or unset {VARIABLE}"),
    ):
        if given == NONE and given is variable:
            return Pdal(None, "", how)
        if given:
            program = shutil.which(given, path=search_path) or given
            version = _version_of([program, "--version"])
            if version is None:
                raise InputError(f"PDAL at {shown(given)} ({how}) does not start; {remedy}.")
            return Pdal(Path(program), version, how)
    if importlib.util.find_spec("pdal") is not None:
        version = _version_of([sys.executable, str(_WORKER), "--version"])
        if version is not None:
            return Pdal(None, version, "Python package pdal")
    environ = {**os.environ, "PATH": search_path, QGIS_VARIABLE: qgis, "CONDA_PREFIX": conda}
    places = pdal_places(sys.platform, environ, os.path.isfile, _names_in)
    found: list[Pdal] = []
    for candidate, how in [*places, *([(PRIVATE, "private prefix of the set-up")] if PRIVATE.is_file() else [])]:
        version = _version_of([str(candidate), "--version"])
        if version is not None:
            found.append(Pdal(Path(candidate), version, how))
    return max(found, key=lambda p: p.release, default=NO_PDAL)  # the first of equals


def _names_in(folder: PurePath) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _version_of(arguments: list[str]) -> str | None:
    """What a program says its version is; None if it does not start, or does not end."""
    try:
        result = child_process.run_child(arguments, time_limit_s=_START_S)
    except EngineError:
        return None
    match = re.search(r"(\d+\.\d+(?:\.\d+)?)", result.stdout.decode(errors="replace"))
    return match[1] if result.returncode == 0 and match else None


def _release(version: str) -> tuple[int, ...]:
    return tuple(int(n) for n in re.findall(r"\d+", version)[:3])


@contextmanager
def _run_names(pipeline: list[Stage], folder: Path) -> Iterator[list[Stage]]:
    """The pipeline with names that PDAL takes literally; the writer's file takes its own when the block ends well.

    PDAL expands ``*``, ``?`` and ``[]`` in readers' names and ``#`` in writers'. Such files are read through a link.
    """
    reader, *filters, writer = pipeline
    source = Path(reader["filename"]).absolute()
    if not _taken_literally(source):
        link = folder / f"input{source.suffix if source.suffix[1:].isalnum() else '.las'}"
        _link(source, link)
        source = link
    with atomic_output(Path(writer["filename"]).absolute()) as target:
        output = target if _taken_literally(target) else folder / f"output{target.suffix}"
        yield [{**reader, "filename": str(source)}, *filters, {**writer, "filename": str(output)}]
        if output != target and output.is_file():
            shutil.move(output, target)


def _written(pipeline: list[Stage]) -> int:
    """Bytes that PDAL writes into its temporary folder: a cloud whose name it would change."""
    source, target = Path(pipeline[0]["filename"]), Path(pipeline[-1]["filename"])
    if _taken_literally(target.absolute()) or not source.is_file():
        return 0
    if target.suffix.lower() == ".laz":
        return source.stat().st_size
    header = preflight(source)
    return header.count * header.record_length


def _taken_literally(path: Path) -> bool:
    try:
        return bool(str(path).encode()) and not _UNSAFE.search(str(path))
    except UnicodeEncodeError:
        return False


def _link(path: Path, link: Path) -> None:
    for make in (os.symlink, os.link, shutil.copyfile):
        try:
            make(path, link)
            return
        except OSError:
            continue
    raise InputError(f"{shown(path)} has a name that PDAL cannot take; rename it without []*?#.")


def _failure(result: child_process.ChildResult, pipeline: list[Stage], version: str) -> Exception:
    """What a failed run means for the user."""
    text = " ".join(result.stderr.decode(errors="replace").split())
    message = re.sub(r"^PDAL: ", "", text)
    source = shown(pipeline[0]["filename"])
    if "bad_alloc" in text or "std::length_error" in text:
        return InputError(
            f"PDAL ran out of the memory it may take on {source}; clip the cloud to a smaller area, and check that the "
            "file is sound."
        )
    if message.startswith("readers."):
        return InputError(f"PDAL cannot read {source} ({message[:200]}); copy or export it again.")
    if result.returncode < 0:
        text = f"it was ended by signal {-result.returncode}"
    return EngineError(f"PDAL {version} failed: {(message or text)[:300]}")
