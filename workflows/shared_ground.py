"""The ground of a survey completed with the help of another: the files that an extraction wrote, written anew."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from laspy import DecompressionSelection
from numpy.typing import NDArray

from ..engine.core import cancellation
from ..engine.core.checksums import sha256
from ..engine.core.json_values import plain
from ..engine.epochs.epoch import Epoch
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.ground.labelled_clouds import labelled
from ..engine.ground.pdal_pipelines import GROUND
from ..engine.ground.result import AS_IS, CLASS_2, HEIGHT_OVER_GROUND, GroundResult
from ..engine.ground.shared_ground import Found, Survey, shared_ground
from ..engine.pointcloud import plant_cover
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.reading import read_dimension
from ..engine.pointcloud.records import PLACES, coordinates, read_records
from ..engine.pointcloud.returns import last_returns
from ..engine.pointcloud.writing import copies
from ..engine.vector.corrections import Corrections
from ..interface.corrections import EXCLUDE, NOT_GROUND
from ..interface.parameters import GroundParameters
from .pair import is_large
from .run import Run

_FIELDS = PLACES | DecompressionSelection.CLASSIFICATION
_DIMENSIONS = (HEIGHT_OVER_GROUND, plant_cover.ERROR, plant_cover.HEIGHT)


@dataclass(frozen=True)
class ClassifiedSurvey:
    """All returns of a survey with their classes, in a file of an extraction; ``transform`` moves them to the first.

    ``corrections`` are those by hand that hold for this survey.
    """

    path: Path
    transform: RigidTransform
    corrections: Corrections | None = None

    def read(self, parameters: GroundParameters) -> Survey:
        header = preflight(self.path)
        columns: list[list[NDArray[Any]]] = [[], [], [], []]
        for records in read_records(header, selection=_FIELDS):
            values = (records[name] for name in ("classification", "return_number", "number_of_returns"))
            for column, part in zip(columns, (coordinates(records, header), *values), strict=True):
                column.append(np.array(part))
        xyz, classes, number, total = (np.concatenate(column) for column in columns)
        taken = last_returns(number, total).last if parameters.last_returns else np.ones(len(xyz), dtype=bool)
        if self.corrections is not None:
            without = shapely.union_all([self.corrections.shape(EXCLUDE), self.corrections.shape(NOT_GROUND)])
            taken &= ~shapely.contains_xy(without, xyz[:, 0], xyz[:, 1])
        return Survey(self.transform.apply(xyz), classes == GROUND, taken)


def shared_grounds(
    run: Run,
    epochs: Sequence[Epoch],
    grounds: Sequence[GroundResult],
    parameters: GroundParameters,
    transform: RigidTransform,
    corrections: Corrections | None,
) -> list[GroundResult]:
    """The extractions of two surveys, each completed with the other; their clouds and the record are written anew.

    They stay as they are if ground was given, taken from the cloth alone, or found in tiles, and if there are too many
    returns for the memory.
    """
    extracted = all(ground.tiles is None and ground.filter not in (CLASS_2, AS_IS) for ground in grounds)
    if not extracted or not parameters.refine or is_large([ground.classified for ground in grounds]):
        return list(grounds)
    moves = RigidTransform.identity(), transform
    done = []
    with run.step("shared_ground", 0.68, 0.7, "completing the ground of each survey with the other's"):
        surveys = [
            ClassifiedSurvey(ground.classified, move, corrections and corrections.of(epoch.date)).read(parameters)
            for ground, move, epoch in zip(grounds, moves, epochs, strict=True)
        ]
        for result, own, other in zip(grounds, surveys, reversed(surveys), strict=True):
            found = shared_ground(own, other, parameters.class_threshold)
            count = result.ground_points + len(found.index)
            if len(found.index):
                write_completed(result.classified, (result.classified, result.ground), found)
            share = count / result.roi_points
            done.append(replace(result, ground_points=count, ground_ratio=share, shared_points=len(found.index)))
    for stage in run.record.stages:
        if stage["stage"] == "ground":
            stage["epochs"] = recorded(epochs, done)
    return done


def recorded(epochs: Sequence[Epoch], grounds: Sequence[GroundResult]) -> dict[str, Any]:
    """Of each survey what is known of its ground; a series that goes on from here takes it as it is."""
    return {
        epoch.name: plain(ground) | {"figures": plain(ground.figures()), "sha256": sha256(ground.ground)}
        for epoch, ground in zip(epochs, grounds, strict=True)
    }


def write_completed(source: Path, outputs: tuple[Path, Path], found: Found) -> None:
    """Write the classified and the ground cloud with the ground that was found in addition.

    Args:
        source: the classified cloud of the extraction.
        outputs: the classified and the ground cloud to write, which may be files that are there.
    """
    values = (found.height, found.plant_error, found.plant_height)
    dimensions = {}
    for name, new in zip(_DIMENSIONS, values, strict=True):
        dimensions[name] = np.array(read_dimension(source, name), dtype=np.float32)
        dimensions[name][found.index] = new
    ground = np.array(read_dimension(source, "classification") == GROUND)
    ground[found.index] = True
    every, alone = (output.with_name(f"{output.stem}_shared.laz") for output in outputs)
    with cancellation.temporary(every), cancellation.temporary(alone):
        copies(source, labelled((every, alone), np.ones_like(ground), ground, dimensions))
        os.replace(every, outputs[0])
        os.replace(alone, outputs[1])


def save_found(path: Path, found: Found) -> None:
    """Write what was found as compressed NumPy arrays."""
    with path.open("wb") as file:
        np.savez_compressed(file, **vars(found))


def load_found(path: Path) -> Found:
    """What ``save_found`` wrote."""
    with np.load(path, allow_pickle=False) as arrays:
        return Found(**arrays)
