"""A cloud file that is screened: read in parts, never held as a whole, and copied with its points' labels."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import cast

import numpy as np
import shapely
from laspy import DecompressionSelection as Fields
from laspy import PackedPointRecord
from numpy.typing import NDArray
from pyproj import CRS

from ...engine.core.arrays import Bool, Float
from ...engine.core.errors import EngineError, InputError
from ...engine.core.messages import shown
from ...engine.core.progress import Progress
from ...engine.crs.working_frame import given_crs
from ...engine.ground.classified_ground import MAX_POINTS, warn_of_classes
from ...engine.ground.pdal_pipelines import GROUND
from ...engine.pointcloud.cloud import PointCloud
from ...engine.pointcloud.declared_crs import declared_crs
from ...engine.pointcloud.extent import CheckedRecords
from ...engine.pointcloud.reading import eight_bits, open_cloud
from ...engine.pointcloud.records import PLACES, extra_dimensions, new_dimension, read_records
from ...engine.pointcloud.writing import Target, copy_records
from ...engine.vector.area import read_roi, refuse_outside
from ...interface.parameters import InputParameters
from .result import Screening
from .screen import chosen_by_class

CLASS, PROBABILITY = "slopewatch_class", "slopewatch_prob"
CODES = (0, 64, 65)
"""LAS classes of uplift and subsidence, the first two that users may define."""
_PICTURE_POINTS = 2_000_000


class ScreenedFile:
    """The ground points of a file, in parts.

    Args:
        ground: as ``ScreeningParameters.ground``; extract takes the points of ``listed``.
        roi: vector file of polygons; only points inside are screened.
        listed: (n,) numbers, from 0, of the points that are ground.
        picture: also keep a sample of all points with their colours for a top view.
        known_as: the file that messages name, if another.

    Raises:
        InputError: as ``open_cloud`` and ``read_roi``.
    """

    def __init__(
        self,
        path: Path,
        inputs: InputParameters,
        *,
        ground: str,
        roi: Path | None = None,
        listed: NDArray[np.unsignedinteger] | None = None,
        picture: bool = False,
        known_as: Path | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.known_as = known_as or path
        self.path, self.ground, self._listed = path, ground, listed
        self.progress = progress or Progress()
        self.header, self.frame = open_cloud(path, inputs, self.progress)
        self._declared = self._original_crs(inputs)
        self._roi = None if roi is None else read_roi(roi, self.frame.crs, unit=self.frame.horizontal_factor)
        if self._roi is not None:
            shapely.prepare(self._roi.geometry)
            for note in self._roi.notes:
                self.progress.warning(note)
        factors = np.array(self.frame.factors)
        self._scales, self._offsets = np.array(self.header.scales) * factors, np.array(self.header.offsets) * factors
        self._masks: list[NDArray[np.uint8]] | None = None
        self._sampler = _PictureSampler() if picture else None
        self.class_2 = self.class_2_taken = self.taken = 0

    @property
    def name(self) -> str:
        return shown(self.known_as)

    @property
    def classified(self) -> bool:
        """Whether some points are of class 2; known after the first reading."""
        return self.class_2 > 0

    @property
    def bare(self) -> bool:
        """Whether all points that are screened are known to be ground; known after the first reading."""
        return self._listed is not None or 0 < self.taken == self.class_2_taken

    def parts(self) -> Iterator[Float]:
        """The points (n, 3) that are screened, m, part by part.

        Raises:
            InputError: the points are damaged, or none is to be screened.
        """
        if self._masks is None:
            yield from self._first_reading()
            return
        done = 0
        for records, mask in zip(read_records(self.header, selection=PLACES), self._masks, strict=True):
            yield self._xyz(records)[_unpacked(mask, len(records))]
            done += len(records)
            self.progress.update(done / self.header.count)

    def _first_reading(self) -> Iterator[Float]:
        """The first time also decides which points are screened."""
        masks = []
        classified, kept = [], 0
        pictured = Fields.INTENSITY | Fields.RGB if self._sampler is not None else PLACES
        checked = CheckedRecords(self.header, PLACES | Fields.CLASSIFICATION | pictured)
        for records in checked:
            xyz = self._xyz(records)
            labels = np.asarray(records["classification"])
            kinds = labels == GROUND
            mask = self._chosen(xyz, labels, checked.done - len(records))
            self.class_2 += int(kinds.sum())
            self.class_2_taken += int(kinds[mask].sum())
            self.taken += int(mask.sum())
            masks.append(np.packbits(mask))
            if self.ground == "class_2" and kept < MAX_POINTS:
                classified.append(xyz[mask])
                kept += len(classified[-1])
            if self._sampler is not None:
                self._sampler.add(xyz, records, colours=self.header.colours)
            yield xyz[mask]
            self.progress.update(checked.done / self.header.count)
        extent = checked.extent(self.frame)
        for sentence in extent.warnings:
            self.progress.warning(sentence)
        if not self.taken:
            if self._roi is not None:
                refuse_outside(self._roi, extent.bounds, self.path)
            what = "of class 2" if self.ground == "class_2" else "of the ground"
            where = "" if self._roi is None else f" inside the area {shown(self._roi.path)}"
            raise InputError(
                f"{self.name} has no points {what}{where}; give --ground extract, or check the cloud and area."
            )
        if classified:
            warn_of_classes(self.known_as, np.concatenate(classified), self.progress.warning)
        self._masks = masks

    def _chosen(self, xyz: Float, labels: NDArray[np.uint8], start: int) -> Bool:
        mask = chosen_by_class(labels, self.ground)
        if self._listed is not None:
            mask[:] = False
            first, last = np.searchsorted(self._listed, [start, start + len(xyz)])
            mask[self._listed[first:last].astype(np.int64) - start] = True
        if self._roi is not None:
            mask[mask] = shapely.intersects_xy(self._roi.geometry, xyz[mask, 0], xyz[mask, 1])
        return mask

    def _xyz(self, records: PackedPointRecord) -> Float:
        xyz = np.empty((len(records), 3))
        for axis, field in enumerate("XYZ"):
            np.multiply(records[field], self._scales[axis], out=xyz[:, axis])
            xyz[:, axis] += self._offsets[axis]
        return xyz

    def picture(self) -> PointCloud:
        """Evenly thinned points of the whole file with their colours; after the first reading."""
        assert self._sampler is not None
        return self._sampler.cloud(self.frame.crs, self.path, self.header.colours)

    def write_labelled(self, output: Path, screening: Screening, *, classification: bool = False) -> dict[str, int]:
        """Copy the file as LAZ with every point's label and its probability in extra dimensions.

        Coordinates, order, reference system and all other dimensions stay as they are. Points that were not screened
        are background with probability 0. Labels of an earlier run are replaced.

        Args:
            classification: also set the classes of ``CODES`` where a point is labelled uplift or subsidence.

        Returns:
            How many points are labelled uplift and subsidence.

        Raises:
            InputError: the folder cannot be written, or the point format has no room for the classes.
        """
        header, masks, progress = self.header, self._masks, self.progress
        if masks is None:
            raise EngineError("the cloud has not been read yet")
        self.refuse_classes(classification)
        if {CLASS, PROBABILITY} & {d.name for d in extra_dimensions(header)}:
            progress.warning(f"{self.name} has labels of an earlier screening, which are replaced.")
        label, share = new = [
            new_dimension(CLASS, np.dtype(np.uint8), "0 none 1 uplift 2 subsidence"),
            new_dimension(PROBABILITY, np.dtype(np.float32), "probability of the class"),
        ]
        codes = np.array(CODES, dtype=np.uint8)
        count = np.zeros(3, dtype=np.int64)
        group_masks = iter(masks)

        def change(records: PackedPointRecord, part: slice) -> None:
            mask = _unpacked(next(group_masks), len(records))
            labels, probability = np.zeros(len(records), np.uint8), np.zeros(len(records), np.float32)
            labels[mask], probability[mask] = screening.at(self._xyz(records)[mask])
            records[label.field], records[share.field] = labels, probability
            if classification:
                records["classification"] = np.where(labels > 0, codes[labels], records["classification"])
            count[:] += np.bincount(labels, minlength=3)
            progress.update(part.stop / header.count)

        copy_records(header, [Target(output, self._declared, header.scales, header.offsets, change, new)])
        return {"uplift": int(count[1]), "subsidence": int(count[2])}

    def refuse_classes(self, classification: bool) -> None:
        """Raise InputError if the classes of ``CODES`` are asked for and the file's points have no room for them."""
        if classification and self.header.point_format < 6:
            raise InputError(
                f"{self.name} has point format {self.header.point_format}, whose classes end at 31; leave out "
                "write_classification, or save the cloud as LAS 1.4 with point format 6 first."
            )

    def _original_crs(self, inputs: InputParameters) -> CRS:
        """The reference system of the file's own coordinates."""
        if self.frame.in_metres:
            return self.frame.crs
        declared, _ = declared_crs(self.header)
        if inputs.crs or declared is None:
            return given_crs(inputs.crs)
        return declared


def _unpacked(mask: NDArray[np.uint8], count: int) -> Bool:
    return np.unpackbits(mask, count=count).view(bool)


class _PictureSampler:
    """Evenly thinned points with colours and intensity."""

    def __init__(self) -> None:
        from ..preparation.thinning import Thinning

        self._rows = Thinning(_PICTURE_POINTS)
        self._dtype = np.dtype([("xyz", "<f8", 3), ("rgb", "<u2", 3), ("intensity", "<u2")])

    def add(self, xyz: Float, records: PackedPointRecord, *, colours: bool) -> None:
        rows = np.zeros(len(xyz), self._dtype)
        rows["xyz"], rows["intensity"] = xyz, records["intensity"]
        if colours:
            for band, field in enumerate(("red", "green", "blue")):
                rows["rgb"][:, band] = records[field]
        self._rows.add(rows)

    def cloud(self, crs: CRS, path: Path, coloured: bool) -> PointCloud:
        rows = cast("NDArray[np.void]", self._rows.rows())
        rgb = eight_bits(rows["rgb"]) if coloured else None
        return PointCloud(np.ascontiguousarray(rows["xyz"]), crs, path, rgb=rgb, intensity=rows["intensity"])
