"""``slopewatch screen``: a cloud in, its labelled copy, hazard zones, probabilities and a map out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..engine.core import cancellation
from ..engine.core.errors import InputError
from ..engine.core.messages import shown as named
from ..engine.core.part_folders import part_folder
from ..engine.core.progress import Progress, Renamed
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import refuse_unwritable
from ..engine.ground.extraction import extract_ground
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.pdal_program import find_pdal
from ..engine.pointcloud.records import extra_dimensions, read_records
from ..engine.pointcloud.writing import copy_with
from ..engine.zones.earlier_reviews import NOT_CARRIED
from ..interface.dates import date_in_name
from ..models.screening.cloud_file import ScreenedFile
from ..models.screening.screen import screen_points
from ..models.screening.self_test import self_test
from ..models.screening.zones import outline_hazards
from .layer_files import NO_LAYERS, LayerFiles
from .layers import layers_on_cloud
from .products.screening import Pictured, screening_facts, screening_figures, write_products
from .run import Run, record_name_of
from .settings import ScreeningSettings, groups

_INDEX = "slopewatch_index"
_RASTER = (".tif", ".tiff")
_ENDINGS = {
    "labelled": (".laz",), "zones": (".gpkg",), "probability": _RASTER, "smallest_hazard": _RASTER, "map": (".png",),
}  # fmt: skip


def screen_step(
    cloud: Path,
    targets: dict[str, Path],
    settings: ScreeningSettings,
    *,
    roi: Path | None = None,
    layers: LayerFiles = NO_LAYERS,
    pdal: Path | None = None,
    progress: Progress | None = None,
) -> RunResult:
    """Screen a cloud and write its products.

    Args:
        targets: as of ``default_targets``.
        roi: vector file whose polygons bound the slope; points outside are not screened.
        layers: the road's centreline.

    Raises:
        InputError: something given cannot be used; nothing is written then.
        EngineError: memory ran out, or PDAL failed.
    """
    parameters = settings.screening
    extracting = parameters.ground == "extract"
    recorded = ("inputs", "screening", "road", *(("ground",) if extracting else ()))
    run = Run("screen", groups(settings, *recorded), [("cloud", cloud), ("roi", roi), *layers.inputs], progress)
    record_name = record_name_of(targets["labelled"])
    _refuse_targets(run, {**targets, "run": targets["labelled"].with_name(record_name)})
    digest = run.hash_inputs()[0]
    run_id = run.run_id(digest)
    _read_related(run, targets["zones"].absolute(), (cloud, layers), settings)
    folders = [path.absolute().parent for path in targets.values()]

    def place(path: Path) -> Path:
        return run.stage_in(path.absolute().parent).path(path.name)

    with run.writing(targets["labelled"].absolute().parent, record_name=record_name, others=folders):
        listed = _extracted(run, cloud, targets["labelled"], settings, roi, pdal) if extracting else None
        clip = None if extracting else roi  # what was extracted is clipped already
        source = ScreenedFile(
            cloud,
            settings.inputs,
            ground=parameters.ground,
            roi=clip,
            listed=listed,
            picture=True,
            progress=run.progress,
        )
        source.refuse_classes(parameters.write_classification)
        begin = 0.5 if extracting else 0.0
        middle = begin + 0.3 * (0.8 - begin) if parameters.self_test else 0.8
        with run.step("screening", begin, middle, "screening") as entry:
            screening = screen_points(source, parameters, run.progress)
            entry.update(points=source.header.count, ground_points=screening.ground_points, voxels=len(screening.count))
        with run.step("zones", middle, middle + 0.05, "outlining zones"):
            hazards = outline_hazards(screening, source.frame.crs, parameters, run_id=run_id)
        tested = None
        if parameters.self_test:
            with run.step("self_test", middle + 0.05, 0.85, "self-test"):
                tested = self_test(source, screening, hazards, parameters, run.progress)
        with run.step("products", 0.85, 0.92, "writing zones and rasters"):
            facts = screening_facts(source, screening, tested)
            shown = Pictured(source.picture(), digest, date_in_name(cloud), cloud.stem, facts.get("not_shown", ""))
            write_products(targets, place, hazards, shown, run)
        with run.step("labels", 0.92, 1.0, "writing the labelled cloud"):
            output = place(targets["labelled"])
            labelled = source.write_labelled(output, screening, classification=parameters.write_classification)
        run.figures = screening_figures(source, screening, hazards, labelled, tested)
        run.facts |= {"method": screening.method, "model": screening.model, "run_id": run_id} | facts
        run.outputs |= {name: path.absolute() for name, path in targets.items()} | {"run": run.record_path}
        run.finish_reviews()
    return run.result()


def _read_related(run: Run, zones: Path, given: tuple[Path, LayerFiles], settings: ScreeningSettings) -> None:
    """What people entered in earlier zones, and the road that the new ones of the cloud are placed on."""
    run.related = layers_on_cloud(given[1], (settings.road, None), given[0], settings.inputs, run.progress)
    run.read_reviews(zones.parent, [zones.name], f"{zones.stem}_{NOT_CARRIED}")


def _refuse_targets(run: Run, targets: dict[str, Path]) -> None:
    for name, path in targets.items():
        endings = _ENDINGS.get(name, (path.suffix,))
        if path.suffix.lower() not in endings:
            raise InputError(f"The output {path} ({name}) has another ending than {endings[0]}; give it that one.")
        refuse_unwritable(path)
    run.refuse_outputs(targets.values())


def _extracted(
    run: Run, cloud: Path, output: Path, settings: ScreeningSettings, roi: Path | None, pdal: Path | None
) -> NDArray[np.uint32]:
    """Numbers of the points that are ground, ascending; the ground is extracted in a folder that is removed.

    The points carry their number through the extraction, which clips, denoises and may put them in another order.
    """
    with run.step("ground", 0.0, 0.5, "extracting the ground") as entry:
        count = preflight(cloud).count
        place = output.absolute().parent
        with part_folder(place, f"ground of {output.name}") as folder, cancellation.temporary(folder):
            numbered = folder / f"{cloud.stem}.laz"
            copy_with(cloud, numbered, settings.inputs, dimensions={_INDEX: np.arange(count, dtype=np.uint32)})
            try:
                result = extract_ground(
                    numbered,
                    folder / f"{cloud.stem}_ground.laz",
                    roi=roi,
                    parameters=settings.ground,
                    inputs=replace(settings.inputs, crs="", height_unit="auto"),
                    pdal=find_pdal(pdal),
                    progress=Renamed(run.progress, named(numbered), named(cloud)),
                )
            except InputError as error:
                raise InputError(str(error).replace(named(numbered), named(cloud))) from error
            entry["extraction"] = result.figures()
            entry["pipelines"] = [json.loads(path.read_text(encoding="utf-8")) for path in result.pipelines]
            return _numbers(result.ground)


def _numbers(ground: Path) -> NDArray[np.uint32]:
    header = preflight(ground)
    (index,) = (d for d in extra_dimensions(header) if d.name == _INDEX)
    found = [index.values(group).copy() for group in read_records(header)]
    return np.sort(np.concatenate(found).astype(np.uint32))
