"""``slopewatch topview``: a raw cloud in, rasters to draw on out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..engine.core import cancellation
from ..engine.core.json_values import plain
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.maps.drawing_rasters import drawing_rasters
from ..engine.pointcloud.in_parts import CloudFile
from ..engine.pointcloud.reading import open_cloud
from ..engine.vector.area import Roi, read_roi
from ..interface.dates import date_in_name
from ..interface.parameters import InputParameters, TopViewParameters, given
from .pair import SPOOL
from .products.topview import TOP_VIEW_OUTPUTS, Source, top_view_figures, write_top_view
from .run import Run


def topview_step(
    cloud: Path,
    output_dir: Path,
    parameters: TopViewParameters,
    inputs: InputParameters,
    *,
    roi: Path | None = None,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Picture, hillshade, densities and canopy height of a cloud on one grid.

    Args:
        roi: vector file whose polygons bound what is shown.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    run = Run("topview", {"top_view": parameters, "inputs": inputs}, [("cloud", cloud), ("roi", roi)], progress)
    run.refuse_folder(output_dir, ("run.json", *TOP_VIEW_OUTPUTS), overwrite=overwrite)
    file = CloudFile.of(cloud, inputs, colours=True, classification=True)
    area = region_of(roi, cloud, inputs, progress)
    hashes = run.hash_inputs()
    coarse = _coarse(file, given(parameters.detail), progress)
    with run.writing(output_dir) as stage:
        with run.step("rasters", 0.0, 0.8) as entry, cancellation.temporary(stage.folder / SPOOL) as spool:
            spool.mkdir()
            rasters = drawing_rasters(
                coarse or file, None if area is None else area.geometry, parameters, spool, progress
            )
            entry.update(points=rasters.look.points, noise_points=rasters.look.noise)
            progress.info(rasters.choice.sentence)
        with run.step("products", 0.8, 1.0, "writing the rasters"):
            source = Source(file.crs, date_in_name(cloud), hashes, coarse=coarse is not None)
            write_top_view(run, rasters, source)
        run.facts["cell"] = plain(rasters.choice.facts())
        run.figures = top_view_figures(rasters, coarse=coarse is not None)
    return run.result()


def _coarse(file: CloudFile, detail: float | None, progress: Progress) -> CloudFile | None:
    """The file read to its coarser levels; None where all of it is to be read."""
    if detail is None:
        return None
    coarse = replace(file, spacing=detail)
    chosen = coarse.chosen
    if chosen is None:
        progress.warning(
            f"{shown(file.path)} is read as a whole: it is no COPC, its index is unsound, or nearly all of its points "
            f"are in the levels down to {detail:g} m."
        )
        return None
    progress.info(
        f"{chosen.points:,} of {file.count:,} points are read, of the levels down to {detail:g} m; densities would be "
        "those of the levels and are not written."
    )
    return coarse


def region_of(roi: Path | None, cloud: Path, inputs: InputParameters, progress: Progress) -> Roi | None:
    """The polygons of a region of interest in the metres of a cloud; its notes are shown.

    Raises:
        InputError: it cannot be read.
    """
    if roi is None:
        return None
    frame = open_cloud(cloud, inputs)[1]
    area = read_roi(roi, frame.crs, unit=frame.horizontal_factor)
    for sentence in area.notes:
        progress.warning(sentence)
    return area
