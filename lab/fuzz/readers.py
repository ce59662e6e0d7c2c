"""The functions that read files from users, each on a path, to be fuzzed within a process: many files a second."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.json_shapes import read_json
from slopewatch.engine.epochs.manifest import read_manifest
from slopewatch.engine.geometry.rigid_transform import RigidTransform, registration_facts
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.report.record_shape import run_record
from slopewatch.engine.series.alerts import DEFAULT_TABLE, read_alerts
from slopewatch.interface.parameters import InputParameters
from slopewatch.lab.fuzz import mutations
from slopewatch.lab.fuzz.mutations import Mutation
from slopewatch.lab.fuzz.readers_given import GIVEN, write_given
from slopewatch.models.network.description import read_description
from slopewatch.models.network.weights import configuration_of
from slopewatch.models.screening.relief import calibration_of
from slopewatch.tests.builders import bad_inputs

WEIGHTS = Path(__file__).resolve().parents[2] / "models" / "weights"
Reader = Callable[[Path], object]


def _transform(path: Path) -> None:
    RigidTransform.load(path)
    registration_facts(path)


def _points_model(path: Path) -> None:
    weights = path.with_suffix(".safetensors")
    configuration_of(weights, read_description(weights))


def _relief_model(path: Path) -> None:
    calibration_of(read_description(path.with_suffix(".safetensors")))


READERS: dict[str, tuple[Reader, Mutation]] = {
    "cloud.las": (lambda path: read_cloud(path, InputParameters(crs="EPSG:32651")), mutations.changed_bytes),
    "cloud.laz": (lambda path: read_cloud(path, InputParameters(crs="EPSG:32651")), mutations.changed_bytes),
    "manifest.csv": (read_manifest, mutations.changed_table),
    "alerts.csv": (read_alerts, mutations.changed_table),
    "transform.json": (_transform, mutations.changed_json),
    "run.json": (lambda path: read_json(path, run_record, "{path} cannot be read ({why})."), mutations.changed_json),
    "points.json": (_points_model, mutations.changed_json),
    "relief.json": (_relief_model, mutations.changed_json),
    **GIVEN,
}
"""Reader and kind of change by the name of the sound file that ``sound_files`` makes."""


def sound_files(folder: Path) -> dict[str, bytes]:
    """A sound file for each reader, by name."""
    for ending in ("las", "laz"):
        bad_inputs.cloud(folder / f"cloud.{ending}", bad_inputs.slope(1, 300))
    (folder / "manifest.csv").write_text("date,path\n2024-05-01,cloud.las\n2025-05-01,cloud.laz\n", encoding="utf-8")
    shutil.copy(DEFAULT_TABLE, folder / "alerts.csv")
    matrix = [[1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]]
    facts = {"registration_error_m": 0.01, "unobservable": ["rotation"], "registration_method": "robust"}
    (folder / "transform.json").write_text(json.dumps({"matrix": matrix, "registration": facts}), encoding="utf-8")
    (folder / "run.json").write_text(json.dumps(RECORD), encoding="utf-8")
    for name, shipped in (("points", "slopewatch"), ("relief", "relief")):
        shutil.copy(WEIGHTS / f"{shipped}.json", folder / f"{name}.json")
    write_given(folder, RECORD)
    return {name: (folder / name).read_bytes() for name in READERS}


def refusal(name: str, path: Path) -> str:
    """The sentence with which the reader refuses the file; empty if it takes it.

    Raises:
        AssertionError: the refusal is not one sentence that names the file.
    """
    try:
        READERS[name][0](path)
    except InputError as error:
        sentence = str(error)
        assert path.name in sentence or path.stem in sentence, sentence
        assert sentence.endswith("."), sentence
        assert "\n" not in sentence, sentence
        return sentence
    return ""


RECORD = {
    "software": "SlopeWatch 0.2.0", "command": "change", "started": "2026-01-01T00:00:00+00:00", "seconds": 1.5,
    "parameters": {"change": {"cell": 0.5, "cell_value": "mean"}},
    "inputs": [{"role": "epoch 2024-05-01", "path": "a.laz", "bytes": 5, "sha256": "0"}],
    "epochs": [{"name": "2024-05-01", "date": "2024-05-01"}, {"name": "b", "date": None}],
    "grid": {"cell_m": 0.5, "rows": 2, "columns": 2}, "colour_limit_m": 0.03, "uniform_dz_m": None,
    "level": {"p05_m": 0.01, "median_m": 0.02, "p95_m": 0.03, "by_slope": [{"cells": 2}]},
    "distribution": {
        "bin_m": 0.01, "reach_m": 0.02, "lower": 0, "higher": 1, "compared": [1, 2, 3, 4], "beyond": [0, 0, 0, 1],
        "stable": [1, 2, 2, 0],
    },
    "stable_ground": {"cells": 3, "median_m": 0.0, "nmad_m": 0.01}, "zones": [{"zone_id": "Z1", "dz_mean_m": -0.2}],
    "profiles": [{"name": "a", "length_m": 3.0, "dz_min_m": -0.1, "dz_max_m": 0.1}],
    "volumes": {"rows": [{"group": "g", "quantity": "q", "unit": "m"}], "error_model": {"model": "x"}},
    "stages": [{"stage": "ground", "epochs": {"e": {"classified": "c.laz", "cover": {
        "classes": [{"name": "bare"}],
        "heights": {"from_m": -0.5, "bin_m": 0.1, "returns": [1, 2], "ground": [1, 0], "below": 0, "above": 0},
    }}}}],
    "metrics": {"zone_count": 1}, "warnings": ["x"], "outputs": {"zones": "zones.gpkg"}, "versions": {"numpy": "2"},
}  # fmt: skip
"""A run record with all that the report needs of a change."""
