"""Ground extraction: clip, denoise, lay the slope flat, cloth simulation, refine.

PDAL reads, converts and crops into an uncompressed file, from which all outputs are written in one pass at the end.
From PDAL 2.3 on its filters.csf lays the cloth; below, our own simulation does (see cloth_simulation.py).
Everything else is the same code for both, so both give the same ground.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from shapely import Polygon

from ...interface.parameters import GroundParameters, InputParameters
from ..core import cancellation
from ..core.arrays import Bool
from ..core.errors import EngineError, InputError
from ..core.messages import shown
from ..core.progress import Progress
from ..pointcloud.clipping import clip
from ..pointcloud.header import EmptyCloud, preflight
from ..pointcloud.near_area import near_area
from ..pointcloud.pdal_program import Pdal, find_pdal, keep_pipeline, time_limit_s
from ..pointcloud.reading import open_cloud
from ..pointcloud.writing import Copy, copies
from ..vector.area import read_roi, refuse_outside
from . import pdal_pipelines
from .cloth import METHOD, filling
from .filtering import cloth_threshold, refined, require_points
from .findings import Outcome
from .given_ground import given_choice, given_ground, judge_classes
from .labelled_clouds import labelled, plant_dimensions
from .metrics import coverage, file_coverage, vegetation_cover
from .points import Rules, cloth_frame, cover_of, judge, near_cloth, taking_part, without_outliers
from .result import GroundResult
from .strips.fitting import with_fitted_strips
from .survey import Clipped, Source, read_near, read_points
from .tiles.extraction import Job, extract_in_tiles
from .tiles.memory import fits_by_squares, fits_in_one_piece, refuse_full_disk, refuse_too_dense

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
    """Extract the ground of one cloud, or take that which ``RawGroundParameters`` says.

    In addition to ``output`` (NAME_ground.laz or NAME.laz), these are written: NAME_clipped.laz, NAME_classified.laz
    and the pipelines NAME_clip.json, NAME_cloth.json (only where PDAL lays the cloth) and NAME_select.json, by which
    PDAL makes these files from one another.

    Args:
        cloud: LAS, LAZ or COPC.
        output: LAZ of the ground points, in metres.
        roi: vector file whose polygons bound the region of interest; None for the whole cloud.
        pdal: as ``find_pdal`` gave it; without one, laspy and shapely clip.
        final: folder in which the outputs will lie in the end, if another than ``output``'s; the pipelines name it.

    Raises:
        InputError: the cloud, region or a parameter cannot be used; no ground, or too little to be true.
        EngineError: PDAL failed.
        Cancelled: the command is being cancelled.
    """
    parameters, progress = parameters or GroundParameters(), progress or Progress()
    pdal = pdal or find_pdal()

    def extract(cloud: Path, inputs: InputParameters, progress: Progress) -> GroundResult:
        return _Extraction(cloud, Path(output), parameters, inputs, pdal, final, progress).extract(roi)

    fit = parameters.strips == "auto"
    return with_fitted_strips(extract, Path(cloud), inputs or InputParameters(), fit, progress)


@dataclass
class _Extraction:
    """One run: its files, warnings and times."""

    cloud: Path
    output: Path
    parameters: GroundParameters
    inputs: InputParameters
    pdal: Pdal
    final: Path | None
    progress: Progress
    kept: list[Path] = field(default_factory=list)
    made: list[Path] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def clipped(self) -> Path:
        return self._named("clipped.laz")

    @property
    def classified(self) -> Path:
        return self._named("classified.laz")

    def extract(self, roi: Path | None) -> GroundResult:
        """Do it; files of a run that fails are removed."""
        try:
            return self._extract(roi)
        except BaseException:
            for path in (self.output, self.clipped, self.classified, *self.made):
                path.unlink(missing_ok=True)
            raise

    def _extract(self, roi: Path | None) -> GroundResult:
        with self._step("read", 0.0, 0.1, "checking the cloud"):
            source = self._open(roi)
        with cancellation.temporary(self._file("clip.las")) as plain:
            with self._step("clip", 0.1, 0.3, "clipping"):
                self._require_clipped(self._clip(source, plain), roi)
            found = self._found(source, plain)
            header = preflight(self.classified)
            self._keep("select", pdal_pipelines.select_pipeline(self.classified, self.output, header))
        return self._result(source, found)

    def _found(self, source: Source, plain: Path) -> Outcome:
        if given := given_choice(self.parameters):
            return self._as_given(source, plain, given)
        return self._in_tiles(source, plain) if source.in_tiles else self._in_one_piece(source, plain)

    def _as_given(self, source: Source, plain: Path, given: str) -> Outcome:
        with self._step("select", 0.3, 0.6, "taking the ground"):
            found = given_ground(plain, given, flags_in_class=source.flags_in_class)
            if given == "class_2":
                judge_classes(self.cloud, found, self._warn)
        with self._step("write", 0.6, 1.0, "writing the ground"):
            outputs = self.classified, self.output
            wanted = [Copy(self.clipped), *labelled(outputs, np.ones_like(found.mask), found.mask, {})]
            copies(plain, wanted, flags_in_class=source.flags_in_class)
        return found.outcome(given)

    def _in_one_piece(self, source: Source, plain: Path) -> Outcome:
        rules = Rules(shown(self.cloud), self.parameters, self._warn)
        with self._step("denoise", 0.3, 0.45, "removing outliers"):
            survey = without_outliers(rules, *read_points(plain, flags_in_class=source.flags_in_class))
        with self._step("cloth", 0.45, 0.8, "laying the cloth"):
            taken = taking_part(rules, survey.returns)
            near, method = self._cloth(plain, survey, taken)
        with self._step("refine", 0.8, 0.9, "refining the ground"):
            found = refined(survey.flat, near, taken, self.parameters)
            judge(rules, found, survey, taken)
            dimensions = plant_dimensions(found, survey.plane.dip)
            cover = cover_of(rules, survey, found.ground, dimensions)
        with self._step("write", 0.9, 1.0, "writing the ground"):
            outputs = self.classified, self.output
            wanted = [Copy(self.clipped, survey.keep), *labelled(outputs, survey.keep, found.ground, dimensions)]
            copies(plain, wanted, flags_in_class=source.flags_in_class)
        return Outcome(
            points=len(survey.keep),
            area=coverage(survey.xyz),
            ground_points=int(np.count_nonzero(found.ground)),
            outliers=len(survey.removed),
            vegetation_cover=vegetation_cover(survey.xyz, survey.flat, found.ground, survey.plane.dip),
            spacing=survey.spacing,
            plane=survey.plane,
            scatter=found.scatter,
            threshold=found.threshold,
            method=method,
            cover=cover,
        )

    def _in_tiles(self, source: Source, plain: Path) -> Outcome:
        folder = self._named("tiles")
        with cancellation.temporary(folder):
            folder.mkdir()
            job = Job(
                cloud=self.cloud,
                name=shown(self.cloud),
                plain=plain,
                folder=folder,
                outputs=(self.clipped, self.classified, self.output),
                parameters=self.parameters,
                flags_in_class=source.flags_in_class,
                progress=self.progress,
                step=self._step,
                warn=self._warn,
            )
            return extract_in_tiles(job)

    def _result(self, source: Source, found: Outcome) -> GroundResult:
        raw_points, plane = source.header.count, found.plane
        roi_area = found.area if source.region is None else source.region.area
        return GroundResult(
            ground=self.output,
            clipped=self.clipped,
            classified=self.classified,
            pipelines=tuple(self.kept),
            raw_points=raw_points,
            raw_area=source.area,
            raw_density=raw_points / source.area,
            roi_points=found.points,
            roi_area=roi_area,
            roi_density=found.points / roi_area,
            ground_points=found.ground_points,
            ground_ratio=found.ground_points / found.points,
            vegetation_cover=found.vegetation_cover,
            outliers=found.outliers,
            spacing=found.spacing,
            plane_normal=(float(plane.normal[0]), float(plane.normal[1]), float(plane.normal[2])),
            plane_dip=plane.dip,
            plane_azimuth=plane.azimuth,
            plane_share=plane.inlier_share,
            scatter=found.scatter,
            threshold=found.threshold,
            filter=found.method,
            warnings=tuple(self.warnings),
            seconds=self.seconds,
            cover=found.cover,
            tiles=found.tiles,
        )

    def _open(self, roi: Path | None) -> Source:
        header, frame = open_cloud(self.cloud, self.inputs, self.progress)
        self.warnings += frame.notes
        if header.point_format in pdal_pipelines.WAVEFORM_FORMATS:
            raise InputError(
                f"{shown(self.cloud)} holds waveforms (point format {header.point_format}), which are not read; export "
                "it without them."
            )
        piece = fits_in_one_piece(header.count, header.count, self.parameters)
        large = not piece and not given_choice(self.parameters)
        region = None if roi is None else read_roi(roi, frame.crs, unit=frame.horizontal_factor)
        counted = (None if region is None else region.geometry) if large else Polygon()
        # without PDAL the file is clipped as it is read
        kept = None if region is None or large or not self.pdal.is_there else region.geometry
        near = None if kept is None else near_area(header, frame, kept)
        raw = file_coverage(header, frame, counted, near)
        if region is not None:
            for note in region.notes:
                self._warn(note)
            refuse_outside(region, raw.bounds, self.cloud)
        large = large and not fits_by_squares(raw.places, raw.counts, self.parameters)
        if large:
            refuse_too_dense(self.cloud, raw.places, raw.counts, self.parameters)
            refuse_full_disk(header, raw.points, self.output.absolute().parent)
        odd = raw.largest_class > pdal_pipelines.MAX_PDAL_CLASS
        return Source(header, frame, region, raw.area, odd, raw.has_class_12, large, near)

    def _clip(self, source: Source, plain: Path) -> int:
        """Write the points within the region to ``plain``; how many there are.

        The pipeline is kept as one that writes ``clipped``.
        """
        area = None if source.region is None else source.region.geometry
        kept = pdal_pipelines.clip_pipeline(
            self.cloud, plain if source.odd_classes else self.clipped, source.header, source.frame, area
        )
        self._keep("clip", kept)
        with cancellation.temporary(self._file("near.las")) as near:
            header = read_near(source, near)
            if not self.pdal.is_there or (source.has_class_12 and self.pdal.drops_class_12):
                return clip(header, source.frame, area, plain)
            self._run(pdal_pipelines.clip_pipeline(header.path, plain, header, source.frame, area), source.header.count)
        try:
            return preflight(plain).count
        except EmptyCloud:
            return 0

    def _require_clipped(self, count: int, roi: Path | None) -> None:
        if not count:
            place = f" inside the region {shown(roi)}" if roi else ""
            raise InputError(f"{shown(self.cloud)} has no point{place}; check both.")
        require_points(f"{shown(self.cloud)}{' within the region' if roi else ''}", count)

    def _cloth(self, plain: Path, survey: Clipped, taken: Bool) -> tuple[Bool, str]:
        """(n,) points near the cloth, and what laid it."""
        aligned = cloth_frame(survey, taken, self.parameters)
        # PDAL refuses return numbers of which some are 0, and searches without end where much of the cloth is bare
        sound = self.pdal.has_csf and not survey.returns.mixed
        if sound and not len(filling(aligned, self.parameters.cloth_resolution)):
            near = self._cloth_by_pdal(plain, survey)
            return near, f"PDAL {self.pdal.version} filters.csf"
        return near_cloth(survey, taken, self.parameters), METHOD

    def _cloth_by_pdal(self, plain: Path, survey: Clipped) -> Bool:
        """(n,) points near the cloth; the pipeline is kept as one that reads ``clipped``."""
        parameters, returns = self.parameters, survey.returns
        plane = survey.plane if parameters.slope_aligned else None
        last = parameters.last_returns and returns.usable
        with (
            cancellation.temporary(self._file("denoised.las")) as denoised,
            cancellation.temporary(self._file("cloth.las")) as laid,
        ):
            copies(plain, [Copy(denoised, survey.keep)])
            ran, kept = (
                pdal_pipelines.cloth_pipeline(
                    *paths, preflight(denoised), parameters, cloth_threshold(parameters), plane, last
                )
                for paths in ((denoised, laid), (self.clipped, self._file("cloth.laz")))
            )
            self._run(ran, len(survey.xyz))
            self._keep("cloth", kept)
            _, _, labels = read_points(laid)
        if len(labels) != len(survey.xyz):
            raise EngineError(f"PDAL {self.pdal.version} returned {len(labels)} of {len(survey.xyz)} points")
        return labels == pdal_pipelines.GROUND

    def _run(self, pipeline: list[pdal_pipelines.Stage], points: int) -> None:
        memory = _BASE_MEMORY_BYTES + _MEMORY_PER_POINT_BYTES * points
        self.pdal.run(pipeline, memory_limit=memory, time_limit_s=time_limit_s(points), cloud=self.cloud)

    def _keep(self, name: str, pipeline: list[pdal_pipelines.Stage]) -> None:
        self.kept.append(self._file(f"{name}.json"))
        keep_pipeline(pipeline, self.kept[-1], self.final)

    def _named(self, ending: str) -> Path:
        stem = self.output.stem.removesuffix("_ground") or self.output.stem
        return self.output.with_name(f"{stem}_{ending}")

    def _file(self, ending: str) -> Path:
        self.made.append(self._named(ending))
        return self.made[-1]

    def _warn(self, sentence: str) -> None:
        if not sentence:
            return
        self.warnings.append(sentence)
        self.progress.warning(sentence)

    @contextmanager
    def _step(self, name: str, start: float, end: float, message: str) -> Iterator[None]:
        began = time.monotonic()
        with self.progress.stage(start, end, message):
            yield
        self.seconds[name] = round(time.monotonic() - began, 3)
