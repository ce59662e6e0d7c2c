"""The network on points deciding by zones: what is shown, at which level, and that its probabilities only inform."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.dominant_plane import apply_matrix
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import ScreeningParameters
from slopewatch.models.configuration import PAPER, SMOKE, ModelConfiguration
from slopewatch.models.preparation import point_scores
from slopewatch.models.preparation.raster_zones import zones_above
from slopewatch.models.preparation.relief_raster import relief_raster
from slopewatch.tests.builders.screening_clouds import (
    BULGE,
    HOLLOW,
    near,
    screen,
    screen_cloud,
    slope,
    small_weights,
    write,
)

pytestmark = pytest.mark.usefixtures("torch")


@pytest.fixture(scope="module")
def cloud(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("slope") / "2024-05-01.laz", slope())


def network(**given) -> ScreeningParameters:
    return ScreeningParameters(screening_method="network", threads=1, **given)


def test_the_bulge_and_the_hollow_are_zones_whose_points_are_labelled(cloud, tmp_path):
    done = screen(cloud, tmp_path / "out.laz", method="network")
    zones = geopandas.read_file(done.outputs["zones"], layer="zones").set_index("kind")
    las = laspy.read(tmp_path / "out.laz")
    labels, xyz = np.asarray(las.slopewatch_class), np.asarray(las.xyz)
    for kind, name, place in ((1, "uplift", BULGE), (2, "subsidence", HOLLOW)):
        assert (labels[near(xyz, place, 1.0)] == kind).all()
        assert zones.loc[[name]]["points"].sum() / (labels == kind).sum() == pytest.approx(1.0, abs=0.05)
    assert not labels[~near(xyz, BULGE, 5.0) & ~near(xyz, HOLLOW, 5.0)].any()
    record = json.loads(done.outputs["run"].read_text())
    assert record["model"]["level"] == point_scores.LEVELS[1.0]


def test_labels_are_those_of_cells_whose_mean_odds_pass_the_level(cloud):
    """Made again from the network's own prediction for single points."""
    from slopewatch.models.inference.prediction import predict
    from slopewatch.models.network.randlanet import fold_normalisation
    from slopewatch.models.network.shipped import shipped_model
    from slopewatch.models.network.weights import load_model

    points = read_cloud(cloud)
    screening, _ = screen_cloud(points, network(false_zones=0.5))
    probabilities = predict(fold_normalisation(load_model(*shipped_model()).network), points.xyz).probabilities
    flat = apply_matrix(screening.voxels.matrix, points.xyz)
    raster = relief_raster(flat)
    place = raster.index(flat)
    scores = point_scores.point_scores(
        point_scores.cell_means(probabilities, place, np.ones(len(flat)), raster.covered), raster.cell
    )
    level = point_scores.level_for(0.5)
    up, down = (
        zones_above(score, level, raster.cell, point_scores.OUTLINE)[0][place] > 0
        for score in (scores.uplift, scores.subsidence)
    )
    down &= ~up | (scores.subsidence > scores.uplift)[place]
    expected = np.where(down, 2, np.where(up, 1, 0))
    assert {0, 1, 2} == set(expected)
    # Averages of 25 cm stand for the points, which decides about the outline and seldom elsewhere.
    higher = np.maximum(scores.uplift, scores.subsidence)[place]
    clear = np.abs(higher - point_scores.OUTLINE) > 0.4
    assert clear.mean() > 0.95
    assert (screening.at(points.xyz)[0] != expected)[clear].mean() < 0.002


def test_more_accepted_false_zones_show_more(cloud, tmp_path):
    few, many = (screen(cloud, tmp_path / f"{n}.laz", method="network", false_zones=n) for n in (0.2, 10.0))
    assert 0 < few.figures["zone_area_m2"] < many.figures["zone_area_m2"]


def test_the_temperature_changes_no_zone_and_an_improbable_zone_is_left_out(cloud, tmp_path):
    from slopewatch.models.network.shipped import SHIPPED_WEIGHTS

    own = tmp_path / "own.safetensors"
    own.write_bytes(SHIPPED_WEIGHTS.read_bytes())
    description = json.loads(SHIPPED_WEIGHTS.with_suffix(".json").read_text())
    points = read_cloud(cloud)

    def screened(temperature: float, **given):
        metrics = {"calibration": {"temperature": temperature}}
        own.with_suffix(".json").write_text(json.dumps({**description, "metrics": metrics}))
        return screen_cloud(points, network(weights=str(own), **given))[0]

    plain, soft = screened(1.0), screened(4.0)
    np.testing.assert_array_equal(plain.labels, soft.labels)
    highest = {kind: soft.probabilities[soft.labels == kind, kind].max() for kind in (1, 2)}
    assert max(highest.values()) < plain.probabilities[plain.labels > 0, 1:].max()
    assert not screened(4.0, minimum_probability=float(max(highest.values())) + 0.01).labels.any()
    assert screened(1.0, minimum_probability=0.2).labels.any()


def test_models_made_before_and_the_published_pipeline_decide_by_the_most_probable_class(cloud, tmp_path):
    values = asdict(SMOKE)
    assert values.pop("decision") == "zones"
    assert ModelConfiguration.from_mapping(values).decision == "most_probable"
    assert PAPER.decision == "most_probable"
    with pytest.raises(InputError, match="decision is 'oracle'; give zones or most_probable"):
        replace(SMOKE, decision="oracle")
    weights = small_weights(tmp_path / "old.safetensors")
    description = json.loads(weights.with_suffix(".json").read_text())
    del description["configuration"]["decision"]
    weights.with_suffix(".json").write_text(json.dumps(description))
    screening, _ = screen_cloud(read_cloud(cloud), network(weights=str(weights)))
    np.testing.assert_array_equal(screening.labels, screening.probabilities.argmax(axis=1))
    assert "level" not in screening.model
    assert screening.voxels.size == SMOKE.voxel
