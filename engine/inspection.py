"""The whole flow: raw surveys of one slope in, change rasters and hazard zones out."""

from __future__ import annotations

import uuid
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pyproj import CRS

from .change import difference
from .clouds import copy_with, read_cloud
from .epochs import Epoch, check_pair
from .gridding import Float
from .ground import GroundResult, extract_ground
from .outputs import Stage, refuse_inputs_as_outputs, staged_outputs
from .pair import common_area, register_pair, require_comparable, warn_of_doubtful_change
from .parameters import (
    ChangeParameters,
    GroundParameters,
    HeatmapParameters,
    InputParameters,
    RegistrationParameters,
    ZoneParameters,
)
from .pdal import Pdal, find_pdal
from .products import Context, write_products
from .progress import Progress
from .registration import RegistrationResult
from .run_record import RunRecord, plain

CHANGE_OUTPUTS = (
    "elevation_change.tif",
    "level_of_detection.tif",
    "significant_change.tif",
    "zones.gpkg",
    "heatmap.png",
    "heatmap.tif",
    "top_view.tif",
)


@dataclass(frozen=True)
class Settings:
    """All parameter groups of the flow."""

    inputs: InputParameters = field(default_factory=InputParameters)
    ground: GroundParameters = field(default_factory=GroundParameters)
    registration: RegistrationParameters = field(default_factory=RegistrationParameters)
    change: ChangeParameters = field(default_factory=ChangeParameters)
    zones: ZoneParameters = field(default_factory=ZoneParameters)
    heatmap: HeatmapParameters = field(default_factory=HeatmapParameters)

    def groups(self) -> dict[str, Any]:
        return {
            "inputs": self.inputs,
            "ground": self.ground,
            "registration": self.registration,
            "change": self.change,
            "zones": self.zones,
            "heatmap": self.heatmap,
        }


Outcome = tuple[dict[str, Path], dict[str, Any]]


def inspect_slope(
    epochs: tuple[Epoch, Epoch],
    output_dir: Path,
    settings: Settings,
    *,
    roi: Path | None = None,
    stable: Path | None = None,
    pdal: Path | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Ground of both epochs, registration, change, zones, heatmap, run record.

    Args:
        epochs: the earlier and the later survey.
        output_dir: folder for the outputs; made if missing.
        roi: vector file whose polygons bound the managed slope.
        stable: vector file whose polygons are known to be stable; only they register the epochs.
        pdal: the pdal program, if another than the one found.

    Returns:
        Paths of the outputs by name, and the main figures.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    progress = progress or Progress()
    check_pair(*epochs)
    given = [e.path for e in epochs] + [p for p in (roi, stable) if p is not None]
    refuse_inputs_as_outputs([output_dir / name for name in CHANGE_OUTPUTS], given)
    program = find_pdal(pdal)
    record = RunRecord("inspect", settings.groups())
    record.facts["pdal"] = {"version": program.version, "path": program.path, "found": program.how}
    hashes = tuple(record.add_input(f"epoch {e.name}", e.path) for e in epochs)
    for role, path in (("roi", roi), ("stable", stable)):
        if path is not None:
            record.add_input(role, path)
    require_comparable(epochs[0].path, epochs[1].path, settings.inputs)
    with staged_outputs(output_dir) as stage:
        with progress.stage(0.0, 0.6, "extracting the ground"), record.stage("ground") as entry:
            grounds = _grounds(epochs, stage, settings, roi, program, progress)
            entry["epochs"] = {e.name: plain(g) for e, g in zip(epochs, grounds, strict=True)}
        first, second = (read_cloud(g.ground) for g in grounds)
        with progress.stage(0.6, 0.78, "registering"), record.stage("registration") as entry:
            registration = register_pair(first, second, settings.registration, stable, progress)
            aligned = registration.transform.apply(second.xyz)
            entry.update(plain(registration.summary()))
            record.facts["transform"] = registration.transform.matrix
        with progress.stage(0.78, 0.85, "differencing"), record.stage("change"):
            change = difference(
                first.xyz,
                aligned,
                settings.change,
                registration_error=registration.registration_error,
                area=common_area(roi, first, registration.transform),
                progress=progress,
            )
            warn_of_doubtful_change(change, progress)
        clouds = _write_clouds(epochs, grounds, aligned, registration, first.crs, stage)
        with progress.stage(0.85, 0.99, "writing outputs"), record.stage("products"):
            picture = read_cloud(grounds[1].clipped, colours=True)
            picture = replace(picture, xyz=registration.transform.apply(picture.xyz))
            context = Context(
                first=epochs[0],
                second=epochs[1],
                crs=first.crs,
                transform=registration.transform,
                input_hashes=hashes,
                method=f"grid difference ({settings.change.cell_value}), {registration.method} registration",
                run_id=uuid.uuid5(uuid.NAMESPACE_OID, repr((hashes, plain(record.parameters)))).hex[:12],
            )
            files, figures = write_products(change, picture, context, settings.zones, settings.heatmap, stage, progress)
        outputs = files | clouds | {"run": stage.final("run.json")}
        record.metrics = figures | registration.figures()
        for label, result in zip(("reference", "moving"), grounds, strict=True):
            record.metrics |= {f"{label}_{name}": value for name, value in result.figures().items()}
        record.facts["run_id"] = context.run_id
        record.write(stage.path("run.json"), progress.warnings, outputs)
    return outputs, record.metrics


def _grounds(
    epochs: tuple[Epoch, Epoch],
    stage: Stage,
    settings: Settings,
    roi: Path | None,
    program: Pdal,
    progress: Progress,
) -> list[GroundResult]:
    """Both epochs at the same time: the work is in child processes of one thread each."""

    def ground(epoch: Epoch, share: Progress) -> GroundResult:
        return extract_ground(
            epoch.path,
            stage.path(f"clouds/{epoch.name}_ground.laz"),
            roi=roi,
            parameters=settings.ground,
            inputs=settings.inputs,
            pdal=program,
            final=stage.final("clouds"),
            progress=share,
        )

    shares = progress.split([e.name for e in epochs])
    with ThreadPoolExecutor(max_workers=2) as pool:
        return list(pool.map(ground, epochs, shares))


def _write_clouds(
    epochs: tuple[Epoch, Epoch],
    grounds: list[GroundResult],
    aligned: Float,
    registration: RegistrationResult,
    crs: CRS,
    stage: Stage,
) -> dict[str, Path]:
    """The transform, and the later ground moved into the earlier one's frame; names of all clouds kept."""
    registration.transform.save(stage.path("transform.json"), crs, facts=registration.figures())
    name = f"clouds/{epochs[1].name}_aligned.laz"
    copy_with(grounds[1].ground, stage.path(name), xyz=aligned)
    outputs = {"transform": stage.final("transform.json"), "aligned": stage.final(name)}
    for label, result in zip(("reference_ground", "moving_ground"), grounds, strict=True):
        outputs[label] = stage.final(f"clouds/{result.ground.name}")
    return outputs
