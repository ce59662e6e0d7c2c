"""``slopewatch screen``: a cloud in, its labelled copy, hazard zones, probabilities and a map out."""

from __future__ import annotations

import contextlib
import json
import tempfile
import uuid
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engine.core import cancellation
from ..engine.core.errors import InputError
from ..engine.core.json_values import plain
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.staged_outputs import Stage, refuse_inputs_as_outputs, refuse_unwritable, staged_outputs
from ..engine.ground.extraction import extract_ground
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.pdal_program import find_pdal
from ..engine.pointcloud.records import extra_dimensions, read_records
from ..engine.pointcloud.writing import copy_with
from ..engine.zones.earlier_reviews import NOT_CARRIED, EarlierReviews
from ..interface.dates import date_in_name
from ..models.screening.cloud_file import ScreenedFile
from ..models.screening.screen import screen_points
from ..models.screening.zones import outline_hazards
from .products.screening import screening_figures, write_products
from .settings import ScreeningSettings

Outcome = tuple[dict[str, Path], dict[str, Any]]
_INDEX = "slopewatch_index"
_ENDINGS = {"labelled": (".laz",), "zones": (".gpkg",), "probability": (".tif", ".tiff"), "map": (".png",)}


def screen_step(
    cloud: Path,
    targets: dict[str, Path],
    settings: ScreeningSettings,
    *,
    roi: Path | None = None,
    pdal: Path | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Screen a cloud and write its products.

    Args:
        targets: as of ``default_targets``.
        roi: vector file whose polygons bound the slope; points outside are not screened.

    Raises:
        InputError: something given cannot be used; nothing is written then.
        EngineError: memory ran out, or PDAL failed.
    """
    progress = progress or Progress()
    parameters = settings.screening
    run = targets["labelled"].with_name(f"{targets['labelled'].stem}_run.json")
    _refuse_targets({**targets, "run": run}, [cloud, *([roi] if roi else [])])
    record = RunRecord("screen", {"inputs": settings.inputs, "screening": parameters})
    digest = record.add_input("cloud", cloud)
    if roi is not None:
        record.add_input("roi", roi)
    if parameters.ground == "extract":
        record.parameters["ground"] = plain(settings.ground)
    run_id = uuid.uuid5(uuid.NAMESPACE_OID, repr((digest, plain(record.parameters)))).hex[:12]
    zones = targets["zones"].absolute()
    reviews = EarlierReviews(zones.parent, [zones.name], f"{zones.stem}_{NOT_CARRIED}")
    with contextlib.ExitStack() as stack:
        stages: dict[Path, Stage] = {}
        for path in targets.values():
            folder = path.absolute().parent
            if folder not in stages:
                # the folder of the labelled cloud, which gets the run record, is the last to be filled
                stages[folder] = stack.enter_context(staged_outputs(folder, last=run.name))

        def place(path: Path) -> Path:
            return stages[path.absolute().parent].path(path.name)

        share = 0.0
        listed = None
        if parameters.ground == "extract":
            share = 0.5
            with progress.stage(0.0, share, "extracting the ground"), record.stage("ground") as entry:
                listed, facts = _extracted(cloud, targets["labelled"], settings, roi, pdal, progress)
                entry.update(facts)
        source = ScreenedFile(
            cloud,
            settings.inputs,
            ground=parameters.ground,
            roi=roi if listed is None else None,  # what was extracted is clipped already
            listed=listed,
            picture=True,
            progress=progress,
        )
        source.refuse_classes(parameters.write_classification)
        with progress.stage(share, 0.8, "screening"), record.stage("screening") as entry:
            screening = screen_points(source, parameters, progress)
            entry.update(points=source.header.count, ground_points=screening.ground_points, voxels=len(screening.count))
        with progress.stage(0.8, 0.85, "outlining zones"), record.stage("zones"):
            hazards = outline_hazards(screening, source.frame.crs, parameters, run_id=run_id)
        with progress.stage(0.85, 0.92, "writing zones and rasters"), record.stage("products"):
            survey = date_in_name(source.path)
            write_products(
                targets, place, hazards, source.picture(), digest, survey=survey, name=source.path.stem, reviews=reviews
            )
        with progress.stage(0.92, 1.0, "writing the labelled cloud"), record.stage("labels"):
            labelled = source.write_labelled(
                place(targets["labelled"]), screening, classification=parameters.write_classification
            )
        record.metrics = screening_figures(source, screening, hazards, labelled)
        record.facts |= {"model": screening.model, "run_id": run_id}
        outputs = {**{name: path.absolute() for name, path in targets.items()}, "run": run.absolute()}
        record.facts["reviews"] = reviews.finish(stages[reviews.folder], outputs, progress)
        record.write(place(run), progress.warnings, outputs)
    return outputs, record.metrics


def _refuse_targets(targets: dict[str, Path], inputs: list[Path]) -> None:
    for name, path in targets.items():
        endings = _ENDINGS.get(name, (path.suffix,))
        if path.suffix.lower() not in endings:
            raise InputError(f"The output {path} ({name}) has another ending than {endings[0]}; give it that one.")
        refuse_unwritable(path)
    refuse_inputs_as_outputs(targets.values(), inputs)


def _extracted(
    cloud: Path,
    output: Path,
    settings: ScreeningSettings,
    roi: Path | None,
    pdal: Path | None,
    progress: Progress,
) -> tuple[NDArray[np.uint32], dict[str, Any]]:
    """Numbers of the points that are ground, rising, and facts; the ground is extracted in a folder that is removed.

    The points carry their number through the extraction, which clips, denoises and may put them in another order.
    """
    count = preflight(cloud).count
    folder = Path(tempfile.mkdtemp(prefix=".slopewatch-part-", dir=output.absolute().parent))
    with cancellation.temporary(folder):
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
                progress=progress,
            )
        except InputError as error:
            raise InputError(str(error).replace(shown(numbered), shown(cloud))) from error
        facts = {
            "extraction": result.figures(),
            "pipelines": [json.loads(path.read_text(encoding="utf-8")) for path in result.pipelines],
        }
        return _numbers(result.ground), facts


def _numbers(ground: Path) -> NDArray[np.uint32]:
    header = preflight(ground)
    (index,) = (d for d in extra_dimensions(header) if d.name == _INDEX)
    found = [index.values(group).copy() for group in read_records(header)]
    return np.sort(np.concatenate(found).astype(np.uint32))
