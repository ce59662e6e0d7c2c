"""Heights in other units or of another system: refused in one sentence, or taken off and said.

Numbered as the list of bad inputs; test_epoch_pairs.py has the others.
"""

from __future__ import annotations

import json
from datetime import date

import geopandas
import laspy
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slopewatch.engine.change.difference import difference
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.comparability import refuse_other_raw_heights, require_comparable
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.epochs.height_systems import compare_clouds, disagreement
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import (
    InputParameters,
    RegistrationParameters,
)
from slopewatch.tests.builders.epoch_pairs import (
    COARSE,
    SIDE,
    X,
    Y,
    change,
    inspect,
    m3c2,
    refused,
    register,
    series,
    slope,
    write,
)
from slopewatch.workflows import inspect as inspection

FOOT = 1200 / 3937


@pytest.mark.parametrize(
    ("systems", "declared"), [(("32651+5773", "32651+3855"), "EGM96"), (("32651", "32651+5773"), "none")]
)
def test_26_28_declared_height_systems_that_differ_are_named(tmp_path, systems, declared):
    a, b = (write(tmp_path / f"{n}.laz", slope(n), f"EPSG:{system}") for n, system in enumerate(systems))
    refused(tmp_path, lambda: m3c2(a, b), "different height systems", f"0.laz {declared}", "1.laz EGM", "--crs")
    require_comparable(a, b, InputParameters(crs="EPSG:32651+5773"))


def test_27_feet_and_metres_are_compared_in_metres(tmp_path):
    """The same system in feet and in metres; the western third sank by 30 cm."""
    place = np.array([1_500_000.0, -3_000_000.0, 0.0])
    before, after = slope(1) + place, slope(2) + place
    west = after[:, 0] - X - place[0] < 4
    after[west, 2] -= 0.3
    a = write(tmp_path / "metres.laz", before, 26943)
    b = write(tmp_path / "feet.laz", after / FOOT, 2227)
    require_comparable(a, b, InputParameters())
    clouds = [read_cloud(path) for path in (a, b)]
    assert sum("US survey feet" in note for note in clouds[1].notes) == 2
    found = difference(clouds[0].xyz, clouds[1].xyz, COARSE)
    middle = found.grid.west + (np.arange(found.grid.columns) + 0.5) * 0.5 - X - place[0]
    assert np.nanmedian(found.dz[:, middle < 3.5]) == pytest.approx(-0.3, abs=0.01)
    assert np.nanmedian(found.dz[:, middle > 4.5]) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("work", [register, change, m3c2])
@pytest.mark.parametrize("factor", [1 / 0.3048, 0.3048])
def test_27_heights_in_feet_that_no_system_declares(first, work, factor):
    other = write(first.with_name("2025-05-01.laz"), slope(2) * [1, 1, factor])
    words = ("2025-05-01.laz are", f"{factor:.3f} times those of 2024-05-01.laz", "feet", "convert")
    refused(first.parent, lambda: work(first, other), *words)


@pytest.mark.parametrize("offset", [20.0, 27.3, -35.0])
@pytest.mark.parametrize("work", ["robust", "icp", "none", "m3c2", "series"])
def test_28_ellipsoidal_against_orthometric_heights(first, work, offset):
    """With the tilt of a geoid, 4 cm over the slope."""
    xyz = slope(2)
    xyz[:, 2] += offset + 0.04 * (xyz[:, 0] - X) / SIDE
    other = write(first.with_name("2025-05-01.laz"), xyz)
    run = {"m3c2": lambda: m3c2(first, other), "series": lambda: series(first.parent, first, other)}
    words = (f"about {abs(offset):.1f} m {'above' if offset > 0 else 'below'} 2024-05-01.laz over the whole overlap",)
    words += ("2025-05-01.laz", "ellipsoidal against orthometric heights", "same system")
    sentence = refused(first.parent, run.get(work, lambda: register(first, other, method=work)), *words)
    assert "overlap:" in sentence
    assert "do not overlap" not in sentence


def planted(seed: int, tall: float) -> np.ndarray:
    """``slope`` under plants: of nine tenths of the points each lies up to ``tall`` metres higher."""
    xyz = slope(seed, 60_000)
    rng = np.random.default_rng(seed + 100)
    xyz[:, 2] += rng.uniform(0, tall, len(xyz)) * (rng.uniform(size=len(xyz)) < 0.9)
    return xyz


@pytest.mark.parametrize(
    ("later", "words"),
    [
        (planted(2, 4.0) + [0, 0, 27.3], "about 27.3 m above 2024-05-01.laz over the whole overlap"),
        (planted(2, 4.0) * [1, 1, 0.3048], "0.305 times those of 2024-05-01.laz"),
    ],
    ids=["another height system", "feet"],
)
def test_27_and_28_are_reported_by_an_inspection_before_the_ground_is_extracted(tmp_path, monkeypatch, later, words):
    def never(*_, **__):
        raise AssertionError("the ground was extracted")

    monkeypatch.setattr(inspection, "extract_ground", never)
    clouds = [write(tmp_path / "2024-05-01.laz", planted(1, 4.0)), write(tmp_path / "2025-05-01.laz", later)]
    epochs = [Epoch(path, date(2024 + n, 5, 1)) for n, path in enumerate(clouds)]
    refused(tmp_path, lambda: inspect(tmp_path, *epochs), "2025-05-01.laz", words)


@pytest.mark.parametrize("parameters", [{}, {"method": "icp"}])
def test_28_plants_that_were_cut_and_what_registration_takes_off_are_not_reported_too_early(tmp_path, parameters):
    first = write(tmp_path / "a.laz", planted(1, 12.0))
    for later in (planted(2, 0.5), planted(2, 12.0) + [0, 0, 4.0]):
        other = write(tmp_path / "b.laz", later)
        refuse_other_raw_heights(first, other, InputParameters(), RegistrationParameters(**parameters))
    other = write(tmp_path / "b.laz", planted(2, 12.0) + [0, 0, 20.0])
    with pytest.raises(InputError, match=r"about 20\.\d m above"):
        refuse_other_raw_heights(first, other, InputParameters(), RegistrationParameters(**parameters))
    wide = RegistrationParameters(maximum_offset=25.0, **parameters)
    refuse_other_raw_heights(first, other, InputParameters(), wide)


def test_28_the_registration_takes_the_offset_off_where_that_is_asked_for(first):
    other = write(first.with_name("2025-05-01.laz"), slope(2) + [0, 0, 27.3])
    sentence = refused(first.parent, lambda: register(first, other), "maximum_offset of 29 m")
    assert sentence.count("29") == 1
    progress = Progress()
    outputs = register(first, other, progress, maximum_offset=29.0).outputs
    assert np.abs(laspy.read(outputs["aligned"]).xyz - slope(2)).max() < 0.03
    assert any("check its datum and heights" in warning for warning in progress.warnings)


def test_28_what_moved_is_not_taken_for_another_height_system():
    before, after = slope(1), slope(2)
    fallen = after.copy()
    fallen[fallen[:, 1] < Y + 8, 2] -= 5.0
    rotated = Rotation.from_euler("x", 30, degrees=True).apply(after - after.mean(axis=0)) + after.mean(axis=0)
    lowered = after - np.outer(2.0 + 6.0 * (after[:, 0] - X) / SIDE, [0, 0, 1])
    for moved in (after, after + [0.4, -0.3, 0.9], fallen, rotated, lowered):
        assert disagreement(compare_clouds(before, moved), "a", "b", 3.0) is None
    assert compare_clouds(before, after + [100.0, 0, 0]) is None
    assert compare_clouds(before[:10], after) is None
    assert "50" not in str(disagreement(compare_clouds(before, after + [0, 0, 60.0]), "a", "b", 3.0))


def test_29_a_uniform_dz_is_named_and_no_zone(risen):
    out, warnings = risen
    assert any("whole overlap has risen by about 0.40" in w and "no zones are drawn" in w for w in warnings)
    assert len(geopandas.read_file(out / "zones.gpkg", layer="zones")) == 0
    assert json.loads((out / "run.json").read_text())["metrics"]["zone_count"] == 0


@pytest.mark.filterwarnings("error")
def test_29_a_uniform_dz_that_is_left_has_figures_all_the_same(first):
    """Nothing agrees, as all lies 40 cm higher and registration is off."""
    other = write(first.with_name("2025-05-01.laz"), slope(2) + [0, 0, 0.4])
    metrics = register(first, other, method="none").figures
    assert metrics["registration_stable_share"] == 0
    assert metrics["registration_normal_translation_m"] == 0
    assert metrics["registration_error_m"] > 0.3
