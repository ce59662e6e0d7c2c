"""Files of a simulated pair, read back with other programs' readers."""

from __future__ import annotations

import hashlib
import json

import geopandas
import laspy
import numpy as np
import pytest
import rasterio
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.surveys.write import GPS_EPOCH, write_pair
from slopewatch.tests.simulation.conftest import SMALL
from slopewatch.workflows.simulate import survey_step


@pytest.fixture(scope="module")
def paths(pair, tmp_path_factory):
    return write_pair(pair, tmp_path_factory.mktemp("written") / "new")


def test_clouds(pair, paths):
    assert [paths[k].name for k in ("first", "second")] == ["2024-05-01.laz", "2025-05-01.laz"]
    for key, cloud in (("first", pair.first), ("second", pair.second)):
        las = laspy.read(paths[key])
        assert str(las.header.version) == "1.4"
        assert las.header.point_format.id == 7
        assert las.header.parse_crs().to_epsg() == 32651
        assert list(las.header.scales) == [0.001] * 3
        assert np.abs(np.column_stack([las.x, las.y, las.z]) - cloud.xyz).max() < 0.00051
        assert np.array_equal(las["truth_ground"], cloud.truth_ground)
        assert np.array_equal(las.return_number, cloud.return_number)
        assert np.array_equal(las.number_of_returns, cloud.number_of_returns)
        assert np.array_equal(las.intensity, cloud.intensity)
        assert np.array_equal(np.asarray(las.green) // 257, cloud.rgb[:, 1])
        assert np.abs(las.scan_angle * 0.006 - cloud.scan_angle).max() < 0.0031
        flown = GPS_EPOCH.timestamp() + 1e9 + np.asarray(las.gps_time)
        day = paths[key].stem
        assert str(np.datetime64(int(flown.min()), "s")).startswith(day)
        assert las.header.creation_date.isoformat() == day


def test_roi(pair, paths):
    frame = geopandas.read_file(paths["roi"], layer="roi")
    assert frame.crs.to_epsg() == 32651
    assert frame.geometry[0].area == pytest.approx(24.0 * 10.0 / np.tan(np.radians(39.0)), rel=1e-6)


def test_truth_raster(pair, paths):
    with rasterio.open(paths["truth_dz"]) as source:
        assert source.dtypes == ("float32",)
        assert source.nodata == -9999
        assert source.crs.to_epsg() == 32651
        a, _, west, _, _, north = tuple(source.transform)[:6]
        assert a == pytest.approx(0.1)
        assert west / 0.1 == pytest.approx(round(west / 0.1), abs=1e-4)
        dz = source.read(1, masked=True)
    volume = sum(change.volumes[0] - change.volumes[1] for change in pair.changes)
    assert dz.sum() * 0.01 == pytest.approx(volume, abs=2e-3)
    assert dz.mask.any()
    # The survey's own ground heights say the same, where a change is largest.
    row, column = np.unravel_index(np.argmax(np.abs(dz)), dz.shape)
    place = np.array([[west + (column + 0.5) * 0.1, north - (row + 0.5) * 0.1]])
    expected = pair.scene.height_at(place) - pair.scene.with_changes(()).height_at(place)
    assert dz[row, column] == pytest.approx(expected[0], abs=2e-3)


def test_transform_and_truth(pair, paths):
    matrix = np.array(json.loads(paths["truth_transform"].read_text())["matrix"])
    point = pair.second.xyz[0]
    assert (matrix @ [*point, 1.0])[:3] == pytest.approx(pair.transform.apply(point[None])[0], abs=1e-6)
    truth = json.loads(paths["truth"].read_text())
    assert truth["parameters"]["seed"] == SMALL.seed
    assert [c["kind"] for c in truth["changes"]] == [c.kind for c in pair.changes]
    assert truth["volume_raised_m3"] == pytest.approx(sum(c.volumes[0] for c in pair.changes))
    assert truth["epochs"][1]["points"] == len(pair.second)
    first = pair.changes[0]
    place = np.array([[truth["changes"][0]["x"], truth["changes"][0]["y"], 0.0]])
    assert pair.scene.frame.to_local(place)[0, :2] == pytest.approx([first.u, first.v], abs=1e-3)


def test_same_pair_same_bytes(pair, paths, tmp_path):
    again = write_pair(pair, tmp_path)
    for key in ("first", "second", "truth_dz", "truth_transform", "truth"):
        one, two = (hashlib.sha256(p[key].read_bytes()).hexdigest() for p in (paths, again))
        assert one == two, key
    assert {p.name for p in tmp_path.iterdir()} == {p.name for p in again.values()}


def test_uncompressed(pair, tmp_path):
    paths = write_pair(pair, tmp_path, compressed=False)
    assert paths["first"].name == "2024-05-01.las"
    assert len(laspy.read(paths["first"])) == len(pair.first)
    assert paths["first"].stat().st_size > 36 * len(pair.first)


def test_folder_that_cannot_be_made(pair, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="choose another"):
        write_pair(pair, tmp_path / "file" / "folder")


def test_command_writes_everything_it_names(tmp_path):
    done = survey_step(SMALL, tmp_path / "out", Progress())
    outputs, figures = done.outputs, done.figures
    assert set(outputs) >= {"reference", "cloud", "roi", "truth_dz", "truth_transform", "truth", "run"}
    assert {p.name for p in (tmp_path / "out").iterdir()} == {p.name for p in outputs.values()}
    run = json.loads(outputs["run"].read_text())
    assert run["parameters"]["survey"]["seed"] == SMALL.seed
    assert figures["points_cloud"] == len(laspy.read(outputs["cloud"]))


def test_a_pair_under_grass_by_its_step(tmp_path):
    """What the command line and the toolbox call: mown later, and the truth."""
    parameters = SurveyParameters(
        points=6000, length=12.0, height=5.0, vegetation=0.0, grass=1.0, mown="later", multipath=0.01, amplitude=0.0
    )
    done = survey_step(parameters, tmp_path / "out", Progress())
    outputs, figures = done.outputs, done.figures
    share = {}
    for name in ("reference", "cloud"):
        las = laspy.read(outputs[name])
        share[name] = float(np.mean(las["truth_ground"]))
    # The road's strip is bare in both.
    assert share["cloud"] > share["reference"] + 0.15
    assert figures["ground_share"] == pytest.approx(share["reference"])
    assert figures["ground_share_cloud"] == pytest.approx(share["cloud"])
    truth = json.loads(outputs["truth"].read_text())
    assert truth["parameters"]["grass"] == 1.0
    assert truth["parameters"]["mown"] == "later"
