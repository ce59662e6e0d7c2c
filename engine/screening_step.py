"""``slopewatch screen``: a cloud in, its labelled copy, hazard zones, probabilities and a map out."""

from __future__ import annotations

import contextlib
import json
import tempfile
import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import lifecycle, rasters, styles, vectors
from .cloud_writing import copy_with
from .clouds import PointCloud
from .confirmation import FIELDS as CONFIRMATION_FIELDS
from .earlier_reviews import NOT_CARRIED, EarlierReviews
from .epochs import date_in_name
from .errors import InputError
from .ground import extract_ground
from .hazard_map import write_hazard_map
from .hazard_zones import FIELDS, Hazards, outline_hazards
from .las_records import read_records, record_dtype
from .las_writing import extra_fields, read_dimensions
from .outputs import Stage, refuse_inputs_as_outputs, refuse_unwritable, staged_outputs
from .parameters import GroundParameters, InputParameters, ScreeningParameters
from .pdal import find_pdal
from .preflight import POINT_SIZES, preflight, shown
from .progress import Progress
from .review_fields import own_columns
from .run_record import RunRecord, plain
from .screened_file import ScreenedFile
from .screening import Screening, screen_points
from .top_view import top_view, top_view_grid
from .version import VERSION

Outcome = tuple[dict[str, Path], dict[str, Any]]
_INDEX = "slopewatch_index"
_ENDINGS = {"labelled": (".laz",), "zones": (".gpkg",), "probability": (".tif", ".tiff"), "map": (".png",)}


@dataclass(frozen=True)
class ScreeningSettings:
    """The parameter groups of screening; ``ground`` counts where the ground is extracted first."""

    inputs: InputParameters
    ground: GroundParameters
    screening: ScreeningParameters


def default_targets(
    output: Path, zones: Path | None = None, probability: Path | None = None, picture: Path | None = None
) -> dict[str, Path]:
    """Where the outputs go: those not given lie beside the labelled cloud NAME.laz as NAME_zones.gpkg and so on."""
    return {
        "labelled": output,
        "zones": zones or output.with_name(f"{output.stem}_zones.gpkg"),
        "probability": probability or output.with_name(f"{output.stem}_probability.tif"),
        "map": picture or output.with_name(f"{output.stem}_map.png"),
    }


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


def write_products(
    targets: dict[str, Path],
    place: Callable[[Path], Path],
    hazards: Hazards,
    picture: PointCloud,
    digest: str,
    *,
    survey: date | None,
    name: str,
    note: str = "",
    reviews: EarlierReviews | None = None,
) -> None:
    """Write zones, probabilities and map of a screening.

    Args:
        targets: as of ``default_targets``; ``place`` tells where the file of a target is to be written now.
        picture: the cloud that the map's top view shows.
        digest: SHA-256 of the screened file.
        survey: day of the survey. name: of the survey, on the map. note: a sentence more below the map.
        reviews: what people entered in the zones of an earlier run, which the new ones get.
    """
    known = (*FIELDS, *CONFIRMATION_FIELDS)
    frame = hazards.frame
    if reviews is not None:
        frame = reviews.carried_to(frame, targets["zones"].name, known)
    qml = styles.hazards_qml(confirmed="confirmed" in frame)
    layer = vectors.Layer(frame, "zones", qml, "MultiPolygon", own_columns(frame, known), guarded=True)
    vectors.write_layers(place(targets["zones"]), [layer], stamp=survey)
    path = place(targets["probability"])
    up, down = hazards.probability[1], hazards.probability[2]
    bands = {"Probability of a hazard": up + down, "Probability of uplift": up, "Probability of subsidence": down}
    tags = rasters.raster_tags(epochs=(None, survey), software=f"SlopeWatch {VERSION}", input_sha256=digest)
    rasters.write_bands(path, bands, hazards.grid, picture.crs, unit="1", tags=tags)
    styles.write_qml_beside(path, styles.probability_qml())
    view = top_view(picture, top_view_grid(hazards.grid, hazards.grid.cell))
    write_hazard_map(place(targets["map"]), hazards, view, name=name, note=note)


def screening_figures(
    source: ScreenedFile, screening: Screening, hazards: Hazards, labelled: dict[str, int]
) -> dict[str, Any]:
    """The figures that a user reads first; ``labelled`` as ``ScreenedFile.write_labelled`` returns it."""
    frame = hazards.frame
    return {
        "points": source.header.count,
        "ground_points": screening.ground_points,
        "uplift_points": labelled["uplift"],
        "subsidence_points": labelled["subsidence"],
        "zone_count": len(frame),
        "zone_area_m2": float(frame["area_m2"].sum()),
        "uplift_zones": int((frame["kind"] == "uplift").sum()),
        "subsidence_zones": int((frame["kind"] == "subsidence").sum()),
        "screened_area_m2": float(np.isfinite(hazards.heights).sum() * hazards.grid.cell**2),
        "dip": screening.suitability.dip,
        "dip_direction": screening.plane.azimuth,
        "density": screening.suitability.density,
    }


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
    with lifecycle.temporary(folder):
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
    own = read_dimensions(header.vlrs.get(("LASF_Spec", 4)), header.record_length - POINT_SIZES[header.point_format])
    standard = record_dtype(header.point_format, POINT_SIZES[header.point_format])
    dtype = np.dtype(standard.descr + extra_fields(own))
    found = [group.view(dtype)[f"extra:{_INDEX}"].copy() for group in read_records(header)]
    return np.sort(np.concatenate(found).astype(np.uint32))
