"""``slopewatch simulate scenes``: labelled scenes in an output folder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from ..engine.core.earlier_results import refuse_results
from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.staged_outputs import staged_outputs
from ..interface.parameters import ScenesParameters
from ..simulation.hazard_scenes.picture import Panels, draw_panels, panels
from ..simulation.hazard_scenes.scenes import build_scene
from ..simulation.hazard_scenes.sets import SETS
from ..simulation.hazard_scenes.styles import SceneSpec, draw_spec
from ..simulation.hazard_scenes.write import scene_entry, scene_name, write_hazards, write_manifest, write_scene

PICTURED = 12
"""Scenes in the picture, at most."""


def scene_specs(parameters: ScenesParameters) -> list[SceneSpec]:
    """The specifications of the scenes that the parameters ask for.

    Raises:
        InputError: more scenes than the benchmark set has.
    """
    if parameters.benchmark:
        specs = SETS[parameters.kind]().specs
        if parameters.count > len(specs):
            raise InputError(
                f"count is {parameters.count}, but the benchmark set {parameters.kind} has {len(specs)} scenes; give "
                f"at most {len(specs)}."
            )
        return list(specs[: parameters.count])
    return [
        draw_spec(
            parameters.seed + number, parameters.kind, area=parameters.area or None, density=parameters.density or None
        )
        for number in range(parameters.count)
    ]


def scenes_step(
    parameters: ScenesParameters, output_dir: Path, progress: Progress, *, overwrite: bool = False
) -> tuple[dict[str, Path], dict[str, Any]]:
    """Simulate scenes one after the other and write them with their truth; nothing is left when it fails.

    Returns:
        Paths by name: ``scene`` (the first), ``scene_2`` and so on, ``hazards``, ``manifest``, ``picture`` if asked
        for, ``run``; and the main figures.
    """
    specs = scene_specs(parameters)
    refuse_results(output_dir, ("run.json", "manifest.json", "hazards.gpkg"), overwrite=overwrite)
    expected = float(sum(spec.points for spec in specs))
    record = RunRecord("simulate scenes", {"scenes": parameters})
    entries: list[dict[str, Any]] = []
    hazards: list[tuple[str, np.ndarray]] = []
    pictures: list[Panels] = []
    outputs: dict[str, Path] = {}
    simulated = done = 0.0
    with staged_outputs(output_dir) as stage:
        with record.stage("simulate and write") as entry:
            for number, spec in enumerate(specs, start=1):
                name = scene_name(spec)
                progress.update(0.95 * done / expected, f"simulating scene {number} of {len(specs)}")
                started = time.process_time()
                scene = build_scene(spec)
                simulated += time.process_time() - started
                progress.update(0.95 * (done + 0.6 * spec.points) / expected, f"writing {name}")
                write_scene(stage.path(name), scene)
                entries.append(scene_entry(name, scene))
                hazards.append((name, scene.hazards))
                if parameters.picture and len(pictures) < PICTURED:
                    pictures.append(panels(scene))
                outputs["scene" if number == 1 else f"scene_{number}"] = stage.final(name)
                done += spec.points
                del scene
            entry["simulation_cpu_seconds"] = round(simulated, 3)
        progress.update(0.95, "writing the truth")
        write_hazards(stage.path("hazards.gpkg"), hazards)
        outputs["hazards"] = stage.final("hazards.gpkg")
        shares = write_manifest(stage.path("manifest.json"), parameters, entries)
        outputs["manifest"] = stage.final("manifest.json")
        if pictures:
            draw_panels(pictures, stage.path("scenes.png"))
            outputs["picture"] = stage.final("scenes.png")
        outputs["run"] = stage.final("run.json")
        points = sum(entry["points"] for entry in entries)
        record.metrics = {
            "scenes": len(entries),
            "points": points,
            **{f"share_{name}": share for name, share in shares.items()},
            "hazards": sum(entry["hazards"] for entry in entries),
            "simulated_points_per_cpu_second": points / max(simulated, 1e-9),
        }
        record.write(stage.path("run.json"), progress.warnings, outputs)
    return outputs, record.metrics
