"""Ground to train on: files of a folder, surveys left out, simulated slopes; and weights made of it."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.lab.making import relief_grounds as module
from slopewatch.lab.making.relief_grounds import OWN_HAZARDS_COVER, SITES, real_grounds, simulated_grounds
from slopewatch.simulation.hazard_scenes.terrain import build_terrain


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two of the known files: a cloud with two classes and an elevation model with a gap."""
    rng = np.random.default_rng(1)
    las = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    las.xyz = np.column_stack([rng.uniform(0, 40, (4000, 2)), rng.uniform(0, 5, 4000)])
    las.classification = np.where(np.arange(4000) % 4 == 0, 5, 2).astype(np.uint8)
    (tmp_path / "terrain").mkdir()
    las.write(tmp_path / "terrain" / "chablais_forest.laz")
    height = np.add.outer(np.arange(40.0), np.zeros(50)).astype(np.float32)
    height[:10, :10] = -9999.0
    with rasterio.open(
        tmp_path / "terrain" / "slovenia_1m.tif", "w", driver="GTiff", width=50, height=40, count=1, dtype="float32",
        nodata=-9999.0, crs="EPSG:3794", transform=rasterio.Affine(1.0, 0, 500.0, 0, -1.0, 900.0),
    ) as target:  # fmt: skip
        target.write(height, 1)
    return tmp_path


def test_known_files_are_read_and_others_left_out(folder: Path) -> None:
    cloud, model = real_grounds(folder)
    assert (cloud.name, len(cloud.points)) == ("chablais_forest", 3000)
    assert cloud.density == pytest.approx(3000 / 1600, rel=0.1)
    assert (model.name, len(model.points), model.density) == ("slovenia_1m", 1900, 1.0)
    # Rows go south, so that the height falls to the north.
    assert np.corrcoef(model.points[:, 1], model.points[:, 2])[0, 1] < -0.99
    assert [ground.name for ground in real_grounds(folder, ["chablais"])] == ["slovenia_1m"]


def test_unknown_surveys_and_empty_folders_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no survey atlantis"):
        real_grounds(folder, ["atlantis"])
    with pytest.raises(InputError, match="holds none of the known files"):
        real_grounds(folder, [site.survey for site in SITES])


def test_simulated_slopes_are_the_same_again() -> None:
    first, again = simulated_grounds(1)[0], simulated_grounds(1)[0]
    np.testing.assert_array_equal(first.points, again.points)
    assert 2 < first.density < 90


def test_a_share_of_slopes_are_hillsides_without_benches_and_a_share_is_planted(monkeypatch) -> None:
    """Only what is drawn: benches of the specifications that are built, and which mending each slope gets."""
    built, mended, planted = [], [], []

    class Slope:
        xyz = np.random.default_rng(0).uniform(0, 20, (500, 3))
        label = np.arange(500) % 3
        ignore = np.arange(500) == 7

    def mending(name):
        return lambda slope, rng: mended.append(name) or slope

    monkeypatch.setattr(module, "build_scene", lambda spec: built.append(spec) or Slope())
    for name in ("natural", "textured", "with_relief"):
        monkeypatch.setattr(module, name, mending(name))
    monkeypatch.setattr(module, "left_by_plants", lambda xyz, rng: planted.append(len(built)) or xyz)
    monkeypatch.setattr(module, "SIMULATED_DENSITY", (1.0, 1.1))
    grounds = simulated_grounds(60)
    assert len({spec.seed for spec in built}) == 60
    benched = [len(build_terrain(spec, spec.generator(1)).benches) for spec in built]
    hillsides = [number for number, name in zip(benched, mended, strict=True) if name == "with_relief"]
    assert not any(hillsides)
    assert 4 <= len(hillsides) <= 21
    assert any(benched)
    assert 15 <= mended.count("textured") <= 39
    assert mended.count("natural") >= 8
    labelled = [ground.labels is not None for ground in grounds]
    assert 18 <= sum(labelled) <= 42
    assert 6 <= len(planted) <= 60 - sum(labelled)
    for spec, own in zip(built, labelled, strict=True):
        assert own or not (spec.uplift or spec.subsidence)
        assert max(spec.uplift, spec.subsidence) <= OWN_HAZARDS_COVER
    # Points are sorted by x, and their labels with them; what nobody could recognise is unknown.
    one = next(ground for ground in grounds if ground.labels is not None)
    order = np.argsort(Slope.xyz[:, 0])
    np.testing.assert_array_equal(one.labels, np.where(Slope.ignore, 255, Slope.label)[order])


def test_weights_name_what_they_were_trained_on(torch, folder: Path, tmp_path: Path) -> None:
    from slopewatch.lab.making.relief_weights import relief_grounds, train_relief_weights
    from slopewatch.models.training.relief_patches import PatchParameters
    from slopewatch.models.training.sim_on_real import ReliefTraining

    parameters = ReliefTraining(steps=1, patches=1, first=1, patch=PatchParameters(side=32))
    grounds = relief_grounds(folder, ["chablais"], 0, Progress())
    made = train_relief_weights(grounds, tmp_path / "run", parameters, left_out=["chablais"])
    assert made is not None
    network, facts = made
    assert facts["real_ground"] == ["slovenia_1m"]
    assert (facts["left_out"], facts["steps"], facts["simulated_slopes"]) == (["chablais"], 1, 0)
    assert network.parameter_count > 2e5
    assert train_relief_weights(grounds, tmp_path / "late", parameters, seconds=-1.0) is None
