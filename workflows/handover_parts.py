"""A run and, where it is a corridor, each of its slopes as parts of one hand-over."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.handover import naming, stac
from ..engine.handover.about import About
from ..engine.handover.corridor import SLOPES, SlopeRun, no_reports, reports_in_parts, slopes_of, with_reports
from ..engine.handover.held import Held, read_held
from ..interface.parameters import HandoverParameters
from .handover_formats import Part, prepared, write_part

_COLLECTION = "collection.json"


class HandOver:
    """What is handed over of a run, and what became of it.

    ``layers`` and ``rasters`` count what was handed over, ``not_held`` are words for what none of the parts holds.

    Raises:
        InputError: something of it cannot be handed over.
    """

    def __init__(
        self,
        held: Held,
        parameters: HandoverParameters,
        names: Mapping[str, str],
        chosen: tuple[str, ...],
        progress: Progress,
    ) -> None:
        self.layers = self.rasters = 0
        self.not_held = held.missing()
        self._held, self._parameters, self._names, self._chosen = held, parameters, names, chosen
        self._progress = progress
        self._slopes = slopes_of(held) if parameters.each_slope else ()
        there = self._slopes and "report" in chosen
        self._reports = reports_in_parts(self._slopes) if there else no_reports(held)
        self._unknown = set(naming.unknown_names(held.layers, names))
        self._first = prepared(self._corridor_or_run(), parameters, names, chosen, Path(), progress)

    def _corridor_or_run(self) -> Held:
        return with_reports(self._held, self._reports) if self._reports else self._held

    def write(self, folder: Path) -> list[str]:
        """Write all parts into ``folder``; the names of the files from there.

        Raises:
            InputError: a slope cannot be handed over, or nothing of the chosen formats is there.
        """
        files: list[str] = []
        items: list[tuple[str, About]] = []
        count = 1 + len(self._slopes)
        for number, (prefix, part) in enumerate(self._parts(folder)):
            with self._progress.stage(number / count, (number + 1) / count):
                files += [f"{prefix}{name}" for name in write_part(part, self._chosen)]
            items.append((f"./{prefix}item.json", part.about))
            self.layers += len(part.held.layers)
            self.rasters += len(part.held.rasters)
        if not files:
            raise InputError("Nothing of the chosen formats is in the results; choose other formats.")
        if self._slopes and "stac" in self._chosen:
            stac.write_collection(folder / _COLLECTION, self._collection, items)
            files.append(_COLLECTION)
        self._say()
        return files

    def _parts(self, folder: Path) -> Iterator[tuple[str, Part]]:
        """Each part when it is its turn, as the ground of all slopes together need not fit into memory."""
        collection = (f"./{_COLLECTION}", self._collection) if self._slopes else None
        yield "", replace(self._first, folder=folder, reports=self._reports, collection=collection)
        for slope in self._slopes:
            yield f"{SLOPES}/{slope.folder}/", self._part_of(slope, folder / SLOPES / slope.folder)

    def _part_of(self, slope: SlopeRun, folder: Path) -> Part:
        held = read_held(slope.record)
        self._unknown &= set(naming.unknown_names(held.layers, self._names))
        self.not_held = [word for word in self.not_held if word in held.missing()]
        parameters = replace(self._parameters, metadata_title="")  # which is the corridor's
        part = prepared(held, parameters, self._names, self._chosen, folder, self._progress, title=slope.name)
        about = replace(part.about, identifier=f"{slope.folder}-{part.about.identifier}")
        return replace(part, about=about, collection=(f"../../{_COLLECTION}", self._collection))

    @property
    def slopes(self) -> int:
        """How many slopes of a corridor are handed over with it."""
        return len(self._slopes)

    @property
    def _collection(self) -> str:
        """The collection's id: corridors differ by what they were made of."""
        return f"slopewatch-corridor-{str(self._held.record.get('made_of') or self._held.folder.name)[:12]}"

    def _say(self) -> None:
        unknown = [name for name in self._names if name in self._unknown]
        if unknown:
            self._progress.warning(f"The mapping file names fields that this run does not have: {', '.join(unknown)}.")
        for word in self.not_held:
            self._progress.info(f"The run holds no {word}, so none are handed over.")
