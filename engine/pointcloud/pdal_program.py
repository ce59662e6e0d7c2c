"""PDAL: finding it, and running pipelines in a child process that can be cancelled.

Pipelines are lists of stages (dictionaries), as PDAL's documentation describes them. Their last stage is a writer
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
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core import cancellation, child_process
from ..core.errors import EngineError, InputError
from ..core.messages import shown
from ..core.staged_outputs import atomic_output

VARIABLE = "SLOPEWATCH_PDAL"
CSF_SINCE = (2, 3)
"""PDAL 2.2's filters.csf fails on every cloud (https://github.com/PDAL/PDAL/issues/3463)."""
PRIVATE = Path(__file__).resolve().parents[2] / ".pdal" / "bin" / "pdal"
_WORKER = Path(__file__).with_name("pdal_worker.py")
_UNSAFE = re.compile(r"[\[\]*?#\"\\\x00-\x1f\x7f]" if os.name == "posix" else r"[\[\]*?#\"\x00-\x1f\x7f]")
Stage = dict[str, Any]


@dataclass(frozen=True)
class Pdal:
    """A PDAL that starts. ``path`` is the program, None for the Python package; ``how`` says where it was found."""

    path: Path | None
    version: str
    how: str

    @property
    def release(self) -> tuple[int, ...]:
        return _release(self.version)

    @property
    def has_csf(self) -> bool:
        """Whether its filters.csf works."""
        return self.release >= CSF_SINCE

    def run(
        self,
        pipeline: list[Stage],
        *,
        keep: Path | None = None,
        final: Path | None = None,
        memory_limit: int | None = None,
    ) -> dict[str, Any]:
        """Run a pipeline; its writers' files are complete or absent.

        Args:
            pipeline: stages; readers and writers name files as ``filename``.
            keep: where the pipeline is kept as JSON for ``pdal pipeline``.
            final: folder in which the files next to ``keep`` will be in the end, if another; the JSON names it.
            memory_limit: bytes of address space PDAL may take (where the system can limit it).

        Returns:
            PDAL's metadata by stage.

        Raises:
            InputError: a reader cannot read its file, or an output cannot be written.
            EngineError: PDAL failed otherwise.
        """
        with _scratch() as folder, _run_names(pipeline, folder) as safe:
            metadata = folder / "metadata.json"
            if self.path is None:
                arguments: list[str | os.PathLike[str]] = [sys.executable, _WORKER, metadata]
            else:
                arguments = [self.path, "pipeline", "--stdin", "--metadata", metadata]
            result = child_process.run_child(
                arguments,
                stdin=json.dumps({"pipeline": safe}).encode(),
                memory_limit=memory_limit,
                # one thread: several give another cloth, and so other ground, from run to run
                environment={**os.environ, "OMP_NUM_THREADS": "1"},
                directory=folder,  # some releases leave files of the cloth where they run
            )
            if result.returncode:
                raise _failure(result, pipeline, self.version)
            try:
                document = json.loads(metadata.read_text(encoding="utf-8", errors="replace"))
            except (OSError, ValueError) as error:
                raise EngineError(f"PDAL {self.version} ended without its metadata") from error
        if keep is not None:
            text = json.dumps({"pipeline": _kept(pipeline, keep.parent, final or keep.parent)}, indent=2)
            with atomic_output(keep) as temporary:
                temporary.write_text(text + "\n", encoding="utf-8")
        return dict(document.get("stages", document))


def find_pdal(setting: Path | str | None = None) -> Pdal:
    """The PDAL to use: SLOPEWATCH_PDAL, then ``setting``, then the Python package, then PATH or the private prefix.

    Of the one on PATH and the private one the newer is taken.

    Raises:
        InputError: the one asked for does not start, or there is none.
    """
    return _find(os.environ.get(VARIABLE, ""), str(setting or ""), os.environ.get("PATH", ""))


@functools.lru_cache(maxsize=8)
def _find(variable: str, setting: str, search_path: str) -> Pdal:
    for given, how, remedy in (
        (variable, f"environment variable {VARIABLE}", f"correct or unset {VARIABLE}"),
        (setting, "setting", "correct the setting (--pdal)"),
    ):
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
    found: list[Pdal] = []
    private = str(PRIVATE) if PRIVATE.is_file() else None
    for candidate, how in ((shutil.which("pdal", path=search_path), "PATH"), (private, "private prefix of the set-up")):
        version = _version_of([candidate, "--version"]) if candidate else None
        if candidate and version is not None:
            found.append(Pdal(Path(candidate), version, how))
    if not found:
        raise InputError(
            f"PDAL was not found; run `make setup`, install PDAL, or name its program in {VARIABLE} or with --pdal."
        )
    return max(found, key=lambda p: p.release)  # the first of equals: the one on PATH


def _version_of(arguments: list[str]) -> str | None:
    """What a program says its version is; None if it does not start."""
    try:
        result = child_process.run_child(arguments)
    except EngineError:
        return None
    match = re.search(r"(\d+\.\d+(?:\.\d+)?)", result.stdout.decode(errors="replace"))
    return match[1] if result.returncode == 0 and match else None


def _release(version: str) -> tuple[int, ...]:
    return tuple(int(n) for n in re.findall(r"\d+", version)[:3])


@contextmanager
def _scratch() -> Iterator[Path]:
    """A folder with a plain name, in the system's place for temporary files, that goes whatever happens."""
    folder = Path(tempfile.mkdtemp(prefix="slopewatch-"))
    with cancellation.temporary(folder):
        yield folder


@contextmanager
def _run_names(pipeline: list[Stage], folder: Path) -> Iterator[list[Stage]]:
    """The pipeline with names that PDAL takes literally; writers' files take their own names when the block ends well.

    PDAL expands ``*``, ``?`` and ``[]`` in readers' names and ``#`` in writers'. Such files are read through a link.
    """
    safe = copy.deepcopy(pipeline)
    with _nested_outputs([Path(s["filename"]) for s in safe if _is_writer(s)]) as outputs:
        moves: list[tuple[Path, Path]] = []
        for index, stage in enumerate(safe):
            if "filename" not in stage:
                continue
            path = Path(stage["filename"]).absolute()
            if _is_writer(stage):
                target = outputs.pop(0)
                if _UNSAFE.search(str(target)) or not _encodable(target):
                    moves.append((folder / f"output{index}{path.suffix}", target))
                    target = moves[-1][0]
                stage["filename"] = str(target)
            elif _UNSAFE.search(str(path)) or not _encodable(path):
                link = folder / f"input{index}{path.suffix if path.suffix[1:].isalnum() else '.las'}"
                _link(path, link)
                stage["filename"] = str(link)
            else:
                stage["filename"] = str(path)
        yield safe
        for source, target in moves:
            if source.is_file():
                shutil.move(source, target)


@contextmanager
def _nested_outputs(paths: list[Path]) -> Iterator[list[Path]]:
    if not paths:
        yield []
        return
    with atomic_output(paths[0].absolute()) as first, _nested_outputs(paths[1:]) as others:
        yield [first, *others]


def _is_writer(stage: Stage) -> bool:
    return str(stage.get("type", "")).startswith("writers.") and "filename" in stage


def _encodable(path: Path) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _link(path: Path, link: Path) -> None:
    for make in (os.symlink, os.link, shutil.copyfile):
        try:
            make(path, link)
            return
        except OSError:
            continue
    raise InputError(f"{shown(path)} has a name that PDAL cannot take; rename it without []*?#.")


def _kept(pipeline: list[Stage], folder: Path, final: Path) -> list[Stage]:
    """The pipeline for the record: absolute names, in their final folder, with wildcards escaped as PDAL wants it."""
    kept = copy.deepcopy(pipeline)
    for stage in kept:
        if "filename" not in stage:
            continue
        path = Path(stage["filename"]).absolute()
        path = final.absolute() / path.name if path.parent == folder.absolute() else path
        name = str(path)
        if _is_writer(stage):
            name = name.replace("#", "_")
        elif os.name == "posix":
            name = re.sub(r"[*?\[]", r"[\g<0>]", name)
        stage["filename"] = name
    return kept


def _failure(result: child_process.ChildResult, pipeline: list[Stage], version: str) -> Exception:
    """What a failed run means for the user."""
    text = " ".join(result.stderr.decode(errors="replace").split())
    message = re.sub(r"^PDAL: ", "", text)
    reader = next((s for s in pipeline if str(s.get("type", "")).startswith("readers.")), None)
    if "bad_alloc" in text or "std::length_error" in text:
        return InputError(
            f"PDAL ran out of the memory it may take on {shown(reader['filename']) if reader else 'the pipeline'}; "
            "clip the cloud to a smaller area, and check that the file is sound."
        )
    if reader is not None and message.startswith("readers."):
        return InputError(f"PDAL cannot read {shown(reader['filename'])} ({message[:200]}); copy or export it again.")
    if result.returncode < 0:
        text = f"it was ended by signal {-result.returncode}"
    return EngineError(f"PDAL {version} failed: {(message or text)[:300]}")
