"""``change``, ``m3c2`` and ``displacement`` know the registration of a cloud that ``register`` wrote."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import (
    ChangeParameters,
    DisplacementStepParameters,
    LastEpochParameters,
    MovementParameters,
    SurveyParameters,
)
from slopewatch.simulation.surveys.survey import simulate_pair
from slopewatch.simulation.surveys.write import write_pair
from slopewatch.tests.workflows.test_inspect import epochs
from slopewatch.workflows.change import change_step
from slopewatch.workflows.displacement import displacement_step
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.m3c2 import m3c2_step
from slopewatch.workflows.register import register_step
from slopewatch.workflows.settings import DisplacementSettings, DistanceSettings, Settings

SETTINGS = Settings(
    change=ChangeParameters(cell=0.2),
    movement=MovementParameters(movement=False),
    displacement_step=DisplacementStepParameters(displacement=False),
    screening=LastEpochParameters(screen_last_epoch=False),
)
CALL: dict[str, Any] = {"dates": ("2024-05-01", "2025-05-01"), "transform_path": None}


@dataclass(frozen=True)
class Registered:
    """Both grounds, the later one as ``register`` moved it, and an inspection's transform and record of the same."""

    reference: Path
    later: Path
    aligned: Path
    transform: Path
    inspected: dict[str, Any]


@pytest.fixture(scope="module")
def registered(tmp_path_factory: pytest.TempPathFactory) -> Registered:
    folder = tmp_path_factory.mktemp("registered")
    paths = write_pair(
        simulate_pair(SurveyParameters(points=60_000, length=20.0, height=10.0, amplitude=0.4, seed=3)),
        folder / "survey",
    )
    inspect_slope(epochs(paths), folder / "out", SETTINGS, roi=paths["roi"], progress=Progress())
    clouds = sorted((folder / "out" / "clouds").glob("*_ground.laz"))
    register_step(
        *clouds, folder / "aligned.laz", SETTINGS, transform_path=None, given=None, invert=False, stable=None,
        progress=Progress(),
    )  # fmt: skip
    record = json.loads((folder / "out" / "run.json").read_text())
    return Registered(*clouds, folder / "aligned.laz", folder / "out" / "transform.json", record)


def changed(
    reference: Path, moving: Path, out: Path, settings: Settings = SETTINGS, transform: Path | None = None
) -> tuple[dict[str, Any], bool]:
    """The record of ``change``, and whether it says that it does not know the registration's error."""
    progress = Progress()
    change_step(reference, moving, out, settings, **{**CALL, "transform_path": transform}, progress=progress)
    unknown = any("registration's error is not known" in warning for warning in progress.warnings)
    return json.loads((out / "run.json").read_text()), unknown


def test_register_and_change_give_the_level_of_an_inspection(registered: Registered, tmp_path: Path) -> None:
    record, unknown = changed(registered.reference, registered.aligned, tmp_path / "out")
    assert not unknown
    assert record["metrics"]["registration_error_m"] > 0
    by_transform = changed(
        registered.reference, registered.later, tmp_path / "by transform", transform=registered.transform
    )[0]
    # Millimetres of a file change which cells grow (2 of 1,939), and an inspection's cells end at its region.
    for other, tolerance in ((by_transform, 0.02), (registered.inspected, 0.05)):
        for name, limit in (("registration_error_m", 1e-6), ("lod_median_m", tolerance)):
            assert record["metrics"][name] == pytest.approx(other["metrics"][name], rel=limit), name
    np.testing.assert_allclose(record["transform"], registered.inspected["transform"], atol=1e-6)


def test_an_error_that_is_given_wins(registered: Registered, tmp_path: Path) -> None:
    given = replace(SETTINGS, change=replace(SETTINGS.change, registration_error=0.5))
    record, unknown = changed(registered.reference, registered.aligned, tmp_path / "out", given)
    assert (record["metrics"]["registration_error_m"], unknown) == (0.5, False)


@pytest.mark.parametrize("other", ["reference", "aligned"])
def test_a_record_of_other_clouds_says_nothing(registered: Registered, tmp_path: Path, other: str) -> None:
    folder = registered.aligned.parent
    pair = {"reference": registered.reference, "aligned": registered.aligned}
    for name, path in pair.items():
        pair[name] = Path(shutil.copy(path, tmp_path / f"{name}.laz"))
    shutil.copy(folder / "aligned_run.json", tmp_path)
    assert not changed(*pair.values(), tmp_path / "same")[1]
    las = laspy.read(pair[other])
    las.z = las.z + 0.001
    las.write(pair[other])
    assert changed(*pair.values(), tmp_path / "other")[1]


@pytest.mark.parametrize("text", ["", "[]", '{"command": "register"}', '{"command": "change"}'])
def test_another_file_of_that_name_says_nothing(registered: Registered, tmp_path: Path, text: str) -> None:
    aligned = Path(shutil.copy(registered.aligned, tmp_path / "aligned.laz"))
    (tmp_path / "aligned_run.json").write_text(text)
    assert changed(registered.reference, aligned, tmp_path / "out")[1]


def test_distances_and_vectors_know_it_too(registered: Registered, tmp_path: Path) -> None:
    error = registered.inspected["metrics"]["registration_error_m"]
    pair = registered.reference, registered.aligned
    distances = m3c2_step(
        *pair, tmp_path / "points.laz", DistanceSettings(), raster_dir=None, core=None, stable=None, **CALL,
        progress=Progress(),
    )  # fmt: skip
    assert distances.figures["registration_error_m"] == pytest.approx(error, rel=1e-6)
    vectors = displacement_step(*pair, tmp_path / "vectors", DisplacementSettings(), **CALL, progress=Progress())
    assert vectors.figures["registration_error_known"]
