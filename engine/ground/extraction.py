"""Ground extraction: clip, denoise, lay the slope flat, cloth simulation, refine.

PDAL reads, converts, crops and writes. From PDAL 2.3 on its filters.csf lays the cloth; below, the CSF authors'
library does (see csf.py). Everything else is the same code for both, so both give the same ground.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from laspy import DecompressionSelection
from numpy.typing import NDArray

from ...interface.parameters import GroundParameters, InputParameters
from ..core import cancellation
from ..core.arrays import Bool, Float
from ..core.errors import EngineError, InputError
from ..core.messages import shown
from ..core.progress import Progress
from ..crs.working_frame import WorkingFrame
from ..geometry.dominant_plane import Plane, apply_matrix, flattening_matrix
from ..geometry.point_spacing import point_spacing
from ..pointcloud import plant_cover
from ..pointcloud.header import CloudHeader, EmptyCloud, preflight
from ..pointcloud.pdal_program import Pdal, find_pdal
from ..pointcloud.reading import open_cloud
from ..pointcloud.records import PLACES, read_records
from ..pointcloud.returns import Returns, last_returns
from ..pointcloud.writing import copy_with
from ..vector.area import Roi, read_roi, refuse_outside
from . import pdal_pipelines
from .cloth import cloth_ground, filling, refuse_large_cloth
from .cover import GroundCover, cover_facts, cover_warnings
from .doubts import Found, ground_doubts
from .filtering import Filtered, cloth_threshold, dominant_plane, refined, require_points, vertical
from .metrics import coverage, file_coverage, vegetation_cover
from .outliers import outliers
from .result import GroundResult

HEIGHT_OVER_GROUND = "height_over_ground"
"""Name of the dimension in the classified cloud, metres."""
_BASE_MEMORY_BYTES = 4_000_000_000
_MEMORY_PER_POINT_BYTES = 1_000


def extract_ground(
    cloud: Path,
    output: Path,
    *,
    roi: Path | None = None,
    parameters: GroundParameters | None = None,
    inputs: InputParameters | None = None,
    pdal: Pdal | None = None,
    final: Path | None = None,
    progress: Progress | None = None,
) -> GroundResult:
    """Extract the ground of one cloud.

    In addition to ``output`` (NAME_ground.laz or NAME.laz), these are written: NAME_clipped.laz, NAME_classified.laz
    and the pipelines NAME_clip.json, NAME_cloth.json (only where PDAL lays the cloth) and NAME_select.json.

    Args:
        cloud: LAS, LAZ or COPC.
        output: LAZ of the ground points, in metres.
        roi: vector file whose polygons bound the region of interest; None for the whole cloud.
        pdal: as ``find_pdal`` gave it.
        final: folder in which the outputs will lie in the end, if another than ``output``'s; the pipelines name it.

    Raises:
        InputError: the cloud, region or a parameter cannot be used; no ground, or too little to be true.
        EngineError: PDAL or the CSF library failed.
        Cancelled: the command is being cancelled.
    """
    run = _Extraction(
        Path(cloud),
        Path(output),
        parameters or GroundParameters(),
        inputs or InputParameters(),
        pdal or find_pdal(),
        None if final is None else Path(final),
        progress or Progress(),
    )
    return run.extract(roi)


class _Extraction:
    """One run: its files, warnings and times."""

    def __init__(
        self,
        cloud: Path,
        output: Path,
        parameters: GroundParameters,
        inputs: InputParameters,
        pdal: Pdal,
        final: Path | None,
        progress: Progress,
    ) -> None:
        self.cloud, self.output, self.parameters, self.inputs = cloud, output, parameters, inputs
        self.pdal, self.final, self.progress = pdal, final, progress
        self.stem = output.stem.removesuffix("_ground") or output.stem
        self.kept: list[Path] = []
        self.made: list[Path] = []
        self.warnings: list[str] = []
        self.seconds: dict[str, float] = {}

    def extract(self, roi: Path | None) -> GroundResult:
        """Do it; files of a run that fails are removed."""
        try:
            return self._extract(roi)
        except BaseException:
            for path in (self.output, *self.made):
                path.unlink(missing_ok=True)
            raise

    def _extract(self, roi: Path | None) -> GroundResult:
        with self._step("read", 0.0, 0.1, "checking the cloud"):
            header, frame = self._open()
            raw = file_coverage(header, frame.horizontal_factor)
            region = None if roi is None else self._region(roi, frame, raw.bounds)
        clipped = self._file("clipped.laz")
        with self._step("clip", 0.1, 0.3, "clipping"):
            self._clip(header, frame, region, clipped, raw.largest_class)
            xyz, returns, labels = self._read_clipped(clipped, roi)
        roi_points = len(xyz)
        with self._step("denoise", 0.3, 0.45, "removing outliers"):
            plane = dominant_plane(xyz)
            flat = apply_matrix(flattening_matrix(plane), xyz)
            noise = self._noise(flat, labels)
            removed = flat[noise]
            if noise.any():
                copy_with(clipped, clipped, keep=~noise)
                xyz, flat = xyz[~noise], flat[~noise]
                returns = replace(returns, last=returns.last[~noise])
            require_points(f"{shown(self.cloud)} without its outliers", len(xyz))
        spacing = self._check_spacing(xyz)
        with self._step("cloth", 0.45, 0.8, "laying the cloth"):
            taken = self._taking_part(returns)
            near, method = self._cloth(clipped, xyz, flat, plane, returns, taken)
        with self._step("refine", 0.8, 0.9, "refining the ground"):
            found = refined(flat, near, taken, self.parameters)
            self._judge(found, flat, taken, removed, returns)
            dimensions = _dimensions(found, plane.dip)
            cover = self._cover(xyz, found.ground, dimensions, plane.dip)
        with self._step("write", 0.9, 1.0, "writing the ground"):
            classified = self._write(clipped, found.ground, dimensions)
        ground_points = int(np.count_nonzero(found.ground))
        roi_area = coverage(xyz) if region is None else region.area
        return GroundResult(
            ground=self.output,
            clipped=clipped,
            classified=classified,
            pipelines=tuple(self.kept),
            raw_points=header.count,
            raw_area=raw.area,
            raw_density=header.count / raw.area,
            roi_points=roi_points,
            roi_area=roi_area,
            roi_density=roi_points / roi_area,
            ground_points=ground_points,
            ground_ratio=ground_points / roi_points,
            vegetation_cover=vegetation_cover(xyz, flat, found.ground, plane.dip),
            outliers=int(np.count_nonzero(noise)),
            spacing=spacing,
            plane_normal=(float(plane.normal[0]), float(plane.normal[1]), float(plane.normal[2])),
            plane_dip=plane.dip,
            plane_azimuth=plane.azimuth,
            plane_share=plane.inlier_share,
            scatter=found.scatter,
            threshold=found.threshold,
            filter=method,
            warnings=tuple(self.warnings),
            seconds=self.seconds,
            cover=cover,
        )

    def _open(self) -> tuple[CloudHeader, WorkingFrame]:
        header, frame = open_cloud(self.cloud, self.inputs, self.progress)
        self.warnings += frame.notes
        if header.point_format in pdal_pipelines.WAVEFORM_FORMATS:
            raise InputError(
                f"{shown(self.cloud)} holds waveforms (point format {header.point_format}), which PDAL does not "
                "read; export it without them."
            )
        return header, frame

    def _read_clipped(self, clipped: Path, roi: Path | None) -> tuple[Float, Returns, NDArray[np.uint8]]:
        try:
            xyz, returns, labels = _read(preflight(clipped))
        except EmptyCloud:
            place = f" inside the region {shown(roi)}" if roi else ""
            raise InputError(f"{shown(self.cloud)} has no point{place}; check both.") from None
        require_points(f"{shown(self.cloud)}{' within the region' if roi else ''}", len(xyz))
        return xyz, returns, labels

    def _write(self, clipped: Path, ground: Bool, dimensions: dict[str, NDArray[np.float32]]) -> Path:
        """The classified cloud, and of it the ground; the path of the former."""
        classified = self._file("classified.laz")
        labels = np.where(ground, pdal_pipelines.GROUND, pdal_pipelines.UNCLASSIFIED).astype(np.uint8)
        copy_with(clipped, classified, classification=labels, dimensions=dimensions)
        self._run("select", pdal_pipelines.select_pipeline(classified, self.output, preflight(classified)), len(ground))
        self._check_output(int(np.count_nonzero(ground)))
        return classified

    def _region(self, roi: Path, frame: WorkingFrame, bounds: tuple[float, float, float, float]) -> Roi:
        region = read_roi(roi, frame.crs, unit=frame.horizontal_factor)
        for note in region.notes:
            self._warn(note)
        refuse_outside(region, bounds, self.cloud)
        return region

    def _clip(
        self, header: CloudHeader, frame: WorkingFrame, region: Roi | None, clipped: Path, largest_class: int
    ) -> None:
        area = None if region is None else region.geometry
        if largest_class <= pdal_pipelines.LARGEST_CLASS:
            self._run("clip", pdal_pipelines.clip_pipeline(self.cloud, clipped, header, frame, area), header.count)
            return
        with cancellation.temporary(self._file("clip.las")) as plain:
            self._run("clip", pdal_pipelines.clip_pipeline(self.cloud, plain, header, frame, area), header.count)
            # these formats have no class that large: what is in the upper bits of the byte are flags
            copy_with(plain, clipped, flags_in_class=header.point_format < 6)

    def _noise(self, flat: Float, labels: NDArray[np.uint8]) -> Bool:
        if not self.parameters.denoise:
            return np.zeros(len(flat), dtype=bool)
        noise = outliers(flat, self.parameters.denoise_radius, self.parameters.denoise_group)
        return noise | np.isin(labels, pdal_pipelines.NOISE)

    def _check_spacing(self, xyz: Float) -> float:
        spacing = point_spacing(xyz)
        if spacing > self.parameters.cloth_resolution:
            self._warn(
                f"The points of {shown(self.cloud)} are {spacing:.2f} m apart, farther than the cloth's particles "
                f"({self.parameters.cloth_resolution:g} m); give a cloth_resolution of about {2 * spacing:.1f} m."
            )
        return spacing

    def _taking_part(self, returns: Returns) -> Bool:
        """(n,) the points that may be ground."""
        if not self.parameters.last_returns:
            return np.ones(len(returns.last), dtype=bool)
        if not returns.usable:
            self._warn(f"All returns of {shown(self.cloud)} take part in the ground filter: {returns.note}.")
        return returns.last

    def _cloth(
        self, clipped: Path, xyz: Float, flat: Float, plane: Plane, returns: Returns, taken: Bool
    ) -> tuple[Bool, str]:
        """(n,) points near the cloth, and what laid it."""
        parameters = self.parameters
        aligned = flat if parameters.slope_aligned else xyz
        refuse_large_cloth(aligned[taken], parameters.cloth_resolution)
        threshold = cloth_threshold(parameters)
        # PDAL refuses return numbers of which some are 0, and searches without end where much of the cloth is bare
        sound = not returns.mixed and not len(filling(aligned[taken], parameters.cloth_resolution))
        if self.pdal.has_csf and sound:
            chosen = parameters.last_returns and returns.usable
            turned = plane if parameters.slope_aligned else None
            with cancellation.temporary(self._file("cloth.laz")) as laid:
                pipeline = pdal_pipelines.cloth_pipeline(
                    clipped, laid, preflight(clipped), parameters, threshold, turned, chosen
                )
                self._run("cloth", pipeline, len(xyz))
                _, _, labels = _read(preflight(laid))
            if len(labels) != len(xyz):
                raise EngineError(f"PDAL {self.pdal.version} returned {len(labels)} of {len(xyz)} points")
            return labels == pdal_pipelines.GROUND, f"PDAL {self.pdal.version} filters.csf"
        near = np.zeros(len(xyz), dtype=bool)
        near[taken] = cloth_ground(aligned[taken], parameters, threshold=threshold)
        return near, "cloth-simulation-filter"

    def _cover(
        self, xyz: Float, ground: Bool, dimensions: dict[str, NDArray[np.float32]], dip: float
    ) -> GroundCover | None:
        """What covers the ground, where its heights are known; and the warnings about it."""
        if not dimensions:
            return None
        lengths = (
            dimensions[name].astype(np.float64) for name in (HEIGHT_OVER_GROUND, plant_cover.ERROR, plant_cover.HEIGHT)
        )
        cover = cover_facts(xyz, ground, *lengths, dip=dip)
        for sentence in cover_warnings(cover, shown(self.cloud)):
            self._warn(sentence)
        return cover

    def _judge(self, filtered: Filtered, flat: Float, taken: Bool, removed: Float, returns: Returns) -> None:
        """Refuse what cannot be the ground, and tell what may not be."""
        count, found = len(flat), int(np.count_nonzero(filtered.ground))
        if found == 0:
            raise InputError(
                f"No ground was found in {shown(self.cloud)}; check the units of its heights and its region, or give a "
                "larger class_threshold."
            )
        if found < self.parameters.minimum_ground_ratio * count:
            raise InputError(
                f"Only {found} of {count} points of {shown(self.cloud)} came out as ground "
                f"({100 * found / count:.2f} %), too few to be true; check the units of its heights and its outliers, "
                "or lower minimum_ground_ratio."
            )
        height, error = filtered.height, filtered.plant_error
        doubted = Found(flat, filtered.ground, taken, height, error, removed, filtered.threshold)
        for sentence in ground_doubts(shown(self.cloud), doubted, returns.lost):
            self._warn(sentence)

    def _check_output(self, expected: int) -> None:
        written = preflight(self.output).count
        if written != expected:
            raise EngineError(f"{self.output.name} holds {written} points instead of {expected}")

    def _run(self, name: str, pipeline: list[pdal_pipelines.Stage], points: int) -> None:
        keep = self._file(f"{name}.json")
        self.pdal.run(
            pipeline, keep=keep, final=self.final, memory_limit=_BASE_MEMORY_BYTES + _MEMORY_PER_POINT_BYTES * points
        )
        self.kept.append(keep)

    def _file(self, ending: str) -> Path:
        path = self.output.with_name(f"{self.stem}_{ending}")
        self.made.append(path)
        return path

    def _warn(self, sentence: str) -> None:
        self.warnings.append(sentence)
        self.progress.warning(sentence)

    @contextmanager
    def _step(self, name: str, start: float, end: float, message: str) -> Iterator[None]:
        began = time.monotonic()
        with self.progress.stage(start, end, message):
            yield
        self.seconds[name] = round(time.monotonic() - began, 3)


def _dimensions(found: Filtered, dip: float) -> dict[str, NDArray[np.float32]]:
    """What is known of the plants at each point, as the file holds it: vertical metres; nothing without refinement."""
    # distances are square to the slope's plane
    upright = vertical(dip)
    named = {
        HEIGHT_OVER_GROUND: found.height,
        plant_cover.ERROR: found.plant_error,
        plant_cover.HEIGHT: found.plant_height,
    }
    return {name: (values * upright).astype(np.float32) for name, values in named.items() if values is not None}


def _read(header: CloudHeader) -> tuple[Float, Returns, NDArray[np.uint8]]:
    """Coordinates, returns and classes of a cloud that is in metres already."""
    xyz = np.empty((header.count, 3))
    number, total, labels = (np.empty(header.count, dtype=np.uint8) for _ in range(3))
    done = 0
    for records in read_records(header, selection=PLACES | DecompressionSelection.CLASSIFICATION):
        part = slice(done, done + len(records))
        for axis, field in enumerate("XYZ"):
            xyz[part, axis] = records[field] * header.scales[axis] + header.offsets[axis]
        number[part] = records["return_number"]
        total[part] = records["number_of_returns"]
        labels[part] = records["classification"]
        done += len(records)
    return xyz, last_returns(number, total), labels
