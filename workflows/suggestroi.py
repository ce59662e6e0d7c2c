"""``slopewatch suggestroi``: a cloud in, a proposed region of interest out."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ..engine.core import cancellation
from ..engine.core.arrays import Index
from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import refuse_unwritable
from ..engine.grid.cloud_look import CloudLook, looked_through
from ..engine.grid.grid import Grid, cell_index, snapped_grid
from ..engine.maps.qgis_styles import drawn_qml
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.in_parts import CloudFile
from ..engine.vector.geopackage import Layer, write_layers
from ..engine.vector.suggested_region import SIDES_M, SPACINGS_A_SQUARE, SuggestedRegion, suggested_region
from ..interface.dates import date_in_name
from ..interface.parameters import InputParameters, RegionParameters, given
from .pair import SPOOL
from .run import Run, record_name_of

_MOST_SQUARES = 20_000_000


def suggestroi_step(
    cloud: Path,
    output: Path,
    parameters: RegionParameters,
    inputs: InputParameters,
    *,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Propose the part of a cloud that is dense and whole enough to be inspected.

    Raises:
        InputError: something given cannot be used, or nothing is left of the cloud; nothing is written then.
    """
    if output.suffix.lower() != ".gpkg":
        raise InputError(f"The output {output} is to be a GeoPackage; end its name in .gpkg.")
    refuse_unwritable(output)
    run = Run("suggestroi", {"region": parameters, "inputs": inputs}, [("cloud", cloud)], progress)
    record = record_name_of(output)
    run.refuse_folder(output.absolute().parent, (output.name, record), overwrite=overwrite)
    file = CloudFile.of(cloud, inputs, classification=True)
    run.hash_inputs()
    with run.writing(output.absolute().parent, record_name=record) as stage:
        with run.step("read", 0.0, 0.9) as entry, cancellation.temporary(stage.folder / SPOOL) as spool:
            spool.mkdir()
            with progress.stage(0.0, 0.5, "looking at the cloud"):
                look, again = looked_through(file, None, spool, progress)
            grid = snapped_grid(look.bounds, _side(look, parameters, cloud))
            with progress.stage(0.5, 1.0, "counting points"):
                counts = _counted(again(progress), grid)
            entry.update(points=look.points, noise_points=look.noise)
        with run.step("region", 0.9, 1.0, "outlining the region"):
            region = suggested_region(counts, grid, file.crs, parameters)
            if region.frame.empty:
                raise InputError(
                    f"No region is left of {shown(cloud)}; lower --least-density or --spike-width, or draw one by hand."
                )
            layer = Layer(region.frame, "roi", drawn_qml("part"), "MultiPolygon")
            write_layers(stage.path(output.name), [layer], stamp=date_in_name(cloud))
        progress.info(str(region.frame["reason"].iloc[0]))
        run.outputs["roi"] = stage.final(output.name)
        run.figures = _figures(region, grid)
    return run.result()


def _side(look: CloudLook, parameters: RegionParameters, cloud: Path) -> float:
    side = given(parameters.region_cell)
    wanted = side or min(SIDES_M, key=lambda s: abs(math.log(s / (SPACINGS_A_SQUARE * look.spacing))))
    rows, columns = snapped_grid(look.bounds, wanted).shape
    if rows * columns <= _MOST_SQUARES:
        return wanted
    if side is not None:
        raise InputError(f"{rows} by {columns} squares over {shown(cloud)} are too many; give a larger --region-cell.")
    return wanted * 2.0 ** math.ceil(math.log2(math.sqrt(rows * columns / _MOST_SQUARES)))


def _counted(parts: Iterable[PointCloud], grid: Grid) -> Index:
    """(rows, columns) points in each square, without noise."""
    counts = np.zeros(grid.rows * grid.columns, dtype=np.int64)
    for part in parts:
        counts += np.bincount(cell_index(part.xyz, grid), minlength=counts.size)
    return counts.reshape(grid.shape)


def _figures(region: SuggestedRegion, grid: Grid) -> dict[str, float | int]:
    return {
        "parts": len(region.frame),
        "area_m2": region.area,
        "cloud_area_m2": region.cloud_area,
        "area_share": region.area / region.cloud_area,
        "points_share": region.points,
        "density": float(np.average(region.frame["density"], weights=region.frame["area_m2"])),
        "cloud_density": region.typical_density,
        "cut_sparse_m2": region.sparse,
        "cut_thin_m2": region.thin,
        "cut_small_m2": region.small,
        "filled_m2": region.filled,
        "square_m": grid.cell,
    }
