"""The ground of a clipped cloud in tiles: decide for the whole, spread over tiles, find each tile's ground, merge.

1. The clipped file is read a few times in parts: plane, outliers, spacing are decided for the whole (``survey``).
2. Its points go to the files of square tiles (``spool``), as large as the memory limit allows (``layout``).
3. In each tile with its halo the cloth and the triangles give heights (``surfaces``). From all of them the size of the
   windows and the scatter of bare ground are decided once, and each tile's ground is found by them (``judging``).
4. The clipped file is read again, each point gets what its tile found (``merging``), and the clouds are written.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from ....interface.parameters import GroundParameters
from ...core.progress import Progress
from ..cloth import METHOD
from ..cover import cover_warnings
from ..densification import seed_window_of
from ..doubts import doubt_sentences
from ..filtering import require_points
from ..findings import Outcome, refuse_implausible, returns_warning, spacing_warning
from ..layered_ground import Windows
from ..result import TilesUsed
from ..surface_heights import Whole
from .judging import Counts, doubt_facts, judge, label_by_cloth, windows_of
from .layout import HALO_M, Tiles, counted, largest_tiles
from .memory import free_for_tile, memory_limit, refuse_too_dense, refuse_too_wide
from .merging import fill, merge, write_clouds
from .spool import Spool
from .surfaces import MAX_SEAM_DIFFERENCE_M, SEAM_M, Cloth, Seams, lay_surfaces
from .survey import Kept, Survey, look_at_kept, look_through

Step = Callable[[str, float, float, str], AbstractContextManager[None]]


@dataclass(frozen=True)
class Job:
    """What is to be done: the ``cloud`` that was clipped into ``plain``, and where its files go.

    ``outputs`` are the clipped, the classified and the ground cloud; ``folder`` is for the tiles' files. ``step`` takes
    a step's name, its shares of the progress and a message; ``warn`` takes sentences, and
    leaves out empty ones.
    """

    cloud: Path
    name: str
    plain: Path
    folder: Path
    outputs: tuple[Path, Path, Path]
    parameters: GroundParameters
    flags_in_class: bool
    progress: Progress
    step: Step
    warn: Callable[[str], None]


@dataclass(frozen=True)
class _Found:
    """``counts`` of the ground in tiles, the ``windows`` (None where the cloth alone decided), how ``seams`` agree."""

    counts: Counts
    windows: Windows | None
    seams: Seams


def extract_in_tiles(job: Job) -> Outcome:
    """Ground of a cloud larger than memory.

    Raises:
        InputError: the tiles would be too large for the memory limit; no ground, or too little to be true.
        Cancelled: the command is being cancelled.
    """
    parameters = job.parameters
    with job.step("denoise", 0.25, 0.4, "removing outliers"):
        survey = look_through(job.plain, parameters, flags_in_class=job.flags_in_class)
        kept = look_at_kept(survey, parameters)
        require_points(f"{job.name} without its outliers", kept.count)
        for sentence in (
            spacing_warning(job.name, kept.spacing, parameters),
            returns_warning(job.name, survey.returns, parameters),
        ):
            job.warn(sentence)
        spool = Spool(job.folder, _tiles(job, kept))
        fill(spool, survey, parameters)
    found = _ground(job, spool, survey, kept)
    with job.step("write", 0.85, 1.0, "writing the ground"):
        merged = merge(spool, survey, known=found.windows is not None)
        _judge(job, found, survey, kept)
        if merged.cover is not None:
            for sentence in cover_warnings(merged.cover, job.name):
                job.warn(sentence)
        write_clouds(job.plain, merged, job.outputs, flags_in_class=job.flags_in_class)
    return Outcome(
        points=survey.header.count,
        area=kept.area,
        ground_points=found.counts.ground,
        outliers=len(kept.removed),
        vegetation_cover=found.counts.high_cells / max(found.counts.cells, 1),
        spacing=kept.spacing,
        plane=survey.plane,
        scatter=found.windows.scatter if found.windows else 0.0,
        threshold=found.windows.threshold if found.windows else parameters.class_threshold,
        method=f"{METHOD}, in tiles",
        cover=merged.cover,
        tiles=_tiles_used(spool.tiles, found.seams, parameters),
    )


def _tiles(job: Job, kept: Kept) -> Tiles:
    refuse_too_wide(job.cloud, kept.places)
    refuse_too_dense(job.cloud, kept.places, kept.points, job.parameters)
    free = free_for_tile(kept.count, len(kept.places), job.parameters)
    tiles = largest_tiles(counted(kept.places, kept.points), free, job.parameters)
    assert tiles is not None
    job.progress.info(f"{job.name} is worked on in {len(tiles)} tiles of {tiles.side:.0f} m.")
    return tiles


def _ground(job: Job, spool: Spool, survey: Survey, kept: Kept) -> _Found:
    """The ground of all tiles, which is saved."""
    parameters, plane, number = job.parameters, survey.plane, len(spool.tiles)

    cloth = Cloth(plane, parameters, kept.cloth_low)

    def told(tile: int) -> None:
        job.progress.update(tile / number, f"tile {tile} of {number}")

    if not parameters.refine:
        with job.step("cloth", 0.4, 0.85, "laying the cloth"):
            return _Found(label_by_cloth(spool, cloth, kept, told), None, Seams(0, 0.0, 0.0, 0.0))
    whole = Whole(kept.flat_low, seed_window_of(float(kept.flat_size.min())))
    with job.step("cloth", 0.4, 0.6, "laying the cloth"):
        surfaces = lay_surfaces(spool, cloth, whole, told)
    with job.step("refine", 0.6, 0.85, "refining the ground"):
        windows = windows_of(spool, surfaces, parameters)
        return _Found(judge(spool, surfaces, windows, plane, kept, told), windows, surfaces.seams)


def _judge(job: Job, found: _Found, survey: Survey, kept: Kept) -> None:
    refuse_implausible(job.name, found.counts.ground, kept.count, job.parameters)
    facts = doubt_facts(found.counts, found.windows, kept, survey.returns.lost)
    for sentence in doubt_sentences(job.name, facts):
        job.warn(sentence)


def _tiles_used(tiles: Tiles, seams: Seams, parameters: GroundParameters) -> TilesUsed:
    return TilesUsed(
        count=len(tiles),
        side_m=tiles.side,
        halo_m=float(HALO_M),
        west_m=float(tiles.low[0]),
        south_m=float(tiles.low[1]),
        memory_limit_gb=memory_limit(parameters) / 1e9,
        seam_width_m=SEAM_M,
        seam_points=seams.points,
        seam_limit_m=MAX_SEAM_DIFFERENCE_M,
        seam_share_beyond=seams.share_beyond,
        seam_median_m=seams.median_m,
        seam_p99_m=seams.p99_m,
    )
