"""One run of a command: its inputs, steps, outputs and record. Every workflow is a list of steps within one.

    run = Run("change", groups(settings, "inputs", "change"), [("epoch 2024-05-01", path)], progress)
    run.refuse_folder(folder, ("run.json", "zones.gpkg"), overwrite=False)
    run.hash_inputs()
    with run.writing(folder, report=True) as stage:
        with run.step("read", 0.0, 0.3, "reading") as entry:
            entry["points"] = 7
        run.outputs["zones"] = stage.final("zones.gpkg")
        run.figures = {"zone_count": 0}
    return run.result()

What can be refused is refused before ``writing``, so that a refused run touches nothing. The entry point of a workflow
takes the files and options of its command by name; that is why it may have more than seven parameters.
"""

from __future__ import annotations

import contextlib
import os
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..engine.core.earlier_results import refuse_results
from ..engine.core.errors import InputError
from ..engine.core.input_files import refuse_odd_outputs, refuse_unusable
from ..engine.core.json_values import plain
from ..engine.core.part_folders import settle, settle_around
from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import Stage, refuse_inputs_as_outputs, staged_outputs
from ..engine.pointcloud.clipping import CLIPPED_BY
from ..engine.pointcloud.coordinate_step import coordinate_step, judge_steps
from ..engine.pointcloud.pdal_program import Pdal, find_pdal
from ..engine.report.compose import REPORT, read_record, write_report
from ..engine.report.signed.details import details_of
from ..engine.report.signed.typesetting import refuse_without_means
from ..engine.report.signed.write import PDF, write_pdf
from ..engine.zones.earlier_reviews import NOT_CARRIED, EarlierReviews
from ..interface.parameters import DetailParameters, InputParameters, ParameterSet
from ..interface.protocol import TASK_VARIABLE
from .layers import Related

_DETAILS = DetailParameters.record_name
_SURVEYS = ("cloud", "reference", "moving")
"""Roles of inputs that are measured, besides the epochs."""


class Run:
    """Carries one run from its inputs to its record.

    ``outputs`` are the final paths by name and ``figures`` the main figures, which the workflow fills in; ``facts`` are
    entries of their own in the record. ``related`` is the road that zones are placed on and the classes of asset.

    Args:
        command: name of the command, for the record.
        parameters: groups by name, for the record.
        inputs: role and path of each input file; None where it was not given.
        record: one that was begun before, instead of a new one.
    """

    def __init__(
        self,
        command: str,
        parameters: Mapping[str, ParameterSet],
        inputs: Iterable[tuple[str, Path | None]] = (),
        progress: Progress | None = None,
        record: RunRecord | None = None,
    ) -> None:
        self.inputs = tuple(inputs)
        for _, path in self.inputs:
            if path is not None:
                settle_around(path)
        self.progress = progress or Progress()
        self.record = record or RunRecord(command, dict(parameters))
        self.facts = self.record.facts
        if os.environ.get(TASK_VARIABLE):
            self.facts["task"] = os.environ[TASK_VARIABLE]
        reading = parameters.get(InputParameters.record_name)
        self._reading = reading if isinstance(reading, InputParameters) else None
        self.outputs: dict[str, Path] = {}
        self.figures: dict[str, Any] = {}
        self.reviews: EarlierReviews | None = None
        self.related = Related()
        self._stage: Stage | None = None
        self._refused_again: dict[Path, Callable[[], None]] = {}
        self._record_name = "run.json"

    # before anything is written

    def refuse_outputs(self, outputs: Iterable[Path], *, also: Iterable[Path] = ()) -> None:
        """Raise InputError if an output is an input, one of the run's or of ``also``, or two outputs are one file.

        Before that, if an input is no file that its kind can be, or an output is a pipe or a device.
        What killed runs left in the outputs' folders is undone first (see ``settle``).
        """
        outputs = list(outputs)
        for folder in {output.absolute().parent for output in outputs}:
            settle(folder)
        refuse_unusable([*self.inputs, *(("", path) for path in also)])
        refuse_odd_outputs(outputs)
        refuse_inputs_as_outputs(outputs, [*(path for _, path in self.inputs if path is not None), *also])

    def refuse_folder(self, folder: Path, names: Sequence[str], *, overwrite: bool, also: Iterable[Path] = ()) -> None:
        """``refuse_outputs`` of files in ``folder``; InputError, too, if it holds one that is not to be overwritten."""
        self.refuse_outputs([folder / name for name in names], also=also)
        refuse_results(folder, names, overwrite=overwrite)
        self._refused_again[folder.resolve()] = lambda: refuse_results(folder, names, overwrite=overwrite)

    def read_reviews(self, folder: Path, files: Sequence[str], not_carried: str = NOT_CARRIED) -> None:
        """Read what people entered in the zones of an earlier run, which ``finish_reviews`` does not let get lost.

        Raises:
            InputError: a file is there and cannot be read.
        """
        self.reviews = EarlierReviews(folder, files, not_carried)

    def find_pdal(self, given: Path | None) -> Pdal:
        """The pdal program, or that there is none, and what clips instead, named in the record.

        Raises:
            InputError: the one that was asked for does not work.
        """
        program = find_pdal(given)
        self.facts["pdal"] = {"version": program.version, "path": program.path, "found": program.how}
        if not program.is_there:
            self.facts["pdal"]["instead"] = CLIPPED_BY
        return program

    def hash_inputs(self) -> tuple[str, ...]:
        """Put the inputs into the record; their SHA-256 in order, empty for one that was not given.

        Raises:
            InputError: one does not exist or cannot be read; the coordinates of a survey are too coarse; or a report
                to sign is wanted that cannot be made.
        """
        if self._to_be_signed:
            refuse_without_means()
            surveys = [role for role, path in self.inputs if role.startswith("epoch ") and path is not None]
            details_of({"parameters": self.record.parameters}, surveys)
        hashes = tuple("" if path is None else self.record.add_input(role, path) for role, path in self.inputs)
        for role, path in self.inputs:
            if path is not None and (role in _SURVEYS or role.startswith("epoch ")):
                self._check_steps(role, path)
        return hashes

    def _check_steps(self, role: str, path: Path) -> None:
        """Put the step of a survey's coordinates into the record.

        Raises:
            InputError: it is too coarse.
        """
        try:
            steps = coordinate_step(path, self._reading)
        except InputError:  # what is wrong with the file itself is said where it is read
            return
        self.facts.setdefault("coordinate_step_m", {})[role] = steps
        judge_steps(path, steps, self.progress)

    def run_id(self, hashes: tuple[str, ...] | str) -> str:
        """12 hexadecimal digits that stand for the clouds of these SHA-256 and for the parameters."""
        parameters = {name: group for name, group in self.record.parameters.items() if name != _DETAILS}
        return uuid.uuid5(uuid.NAMESPACE_OID, repr((hashes, plain(parameters)))).hex[:12]

    @property
    def _to_be_signed(self) -> bool:
        return bool(self.record.parameters.get(_DETAILS, {}).get("pdf"))

    # the steps

    @contextlib.contextmanager
    def step(
        self, name: str, start: float | None = None, end: float | None = None, message: str = ""
    ) -> Iterator[dict[str, Any]]:
        """A stage of the record and of the progress; the block may add numbers to the record's entry.

        Args:
            start, end: share of the run's progress, 0 to 1; without them the block reports that of the whole run.
        """
        share = None if start is None or end is None else self.progress.stage(start, end, message)
        with share or contextlib.nullcontext(), self.record.stage(name) as entry:
            yield entry

    # the outputs

    @contextlib.contextmanager
    def writing(
        self,
        folder: Path,
        *,
        record_name: str = "run.json",
        others: Iterable[Path] = (),
        report: bool = False,
        pictures: Path | None = None,
    ) -> Iterator[Stage]:
        """Gather the outputs; if the block ends well, write the record and give all of them their names, else none.

        Args:
            folder: of the record, which gets its name last.
            others: more folders that outputs go to, see ``stage_in``.
            report: also draw the report of ``folder``, next to the record and named as that is.
            pictures: of ``others``, the folder of the other outputs that the report shows.

        Raises:
            InputError: a folder cannot be made or written.
        """
        self._record_name = record_name
        with staged_outputs(folder, *others, last=record_name) as self._stage:
            for place in {folder.resolve(), *(other.resolve() for other in others)}:
                # another run may have ended there since that was looked at
                self._refused_again.get(place, _nothing)()
            yield self.stage
            self._write_record(report, pictures)

    @property
    def stage(self) -> Stage:
        """The outputs of the folder that gets the record."""
        assert self._stage is not None
        return self._stage

    def stage_in(self, folder: Path) -> Stage:
        """The outputs of one of the folders that ``writing`` was given."""
        return self.stage.beside(folder)

    @property
    def record_path(self) -> Path:
        """Where the record will lie; it becomes the output ``run`` at the end, unless it has its place before."""
        return self.stage.final(self._record_name)

    def finish_reviews(self) -> None:
        """Write what no zone continues of the reviews read, and put into the record what became of all of them."""
        if self.reviews is not None:
            stage = self.stage_in(self.reviews.folder)
            self.facts["reviews"] = self.reviews.finish(stage, self.outputs, self.progress)

    def _write_record(self, report: bool, pictures: Path | None) -> None:
        self.outputs.setdefault("run", self.record_path)
        self.record.metrics = self.figures
        if report:
            # The record promises the report, which is made of it, and is written again for the report's own stage.
            name = report_name_of(self._record_name)
            self.outputs["report"] = self.stage.final(name)
            signed = pdf_name_of(self._record_name)
            if self._to_be_signed:
                self.outputs["report_pdf"] = self.stage.final(signed)
            else:
                self.stage.discard(signed)  # that of an earlier run
            self._save_record()
            shown = None if pictures is None else self.stage_in(pictures).folder
            with self.step("report", 0.99, 1.0, "drawing the report"):
                folder, target = self.stage.folder, self.stage.path(name)
                page = write_report(folder, self.progress, target, record=self._record_name, pictures=shown)
                if self._to_be_signed:
                    record, words = read_record(folder, self._record_name), page.read_text(encoding="utf-8")
                    pdf = self.stage.path(signed)
                    write_pdf(shown or folder, record, words, target=pdf, progress=self.progress)
        self._save_record()

    def _save_record(self) -> None:
        self.record.write(self.stage.path(self._record_name), self.progress.warnings, self.outputs)

    def result(self) -> RunResult:
        """What the run wrote and measured."""
        return RunResult(self.outputs, self.figures, tuple(self.progress.warnings))


def _nothing() -> None:
    pass


def report_name_of(record_name: str) -> str:
    """Name of the report that lies next to a run record."""
    return record_name.removesuffix("run.json") + REPORT


def pdf_name_of(record_name: str) -> str:
    """Name of the report to sign that lies next to a run record."""
    return record_name.removesuffix("run.json") + PDF


def record_name_of(output: Path) -> str:
    """Name of the run record of a command whose main output is one file."""
    return f"{output.stem}_run.json"
