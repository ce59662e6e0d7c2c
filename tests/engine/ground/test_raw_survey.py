"""Raw surveys among clouds that are compared as they are: told from bare surfaces, refused with a remedy."""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from click.testing import CliRunner
from pyproj import CRS
from slopewatch.cli.program import cli
from slopewatch.engine.core import cancellation
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.ground.raw_survey import Bareness, bareness, refuse_raw, taken_as_ground, thick_share
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import InputParameters, SurveyParameters
from slopewatch.simulation.surveys.survey import SimulatedPair, simulate_pair

LONE_STAR = "EPSG:26914"
"""The file declares another one wrongly."""
BARE = {
    "terrain/santa_cruz_gullies.laz": "",
    "terrain/afghan_mountain_ground.laz": "",
    "terrain/british_columbia_forest_ground.laz": "",
    "real/lone-star.copc.laz": LONE_STAR,
    "real/autzen_bmx/autzen-bmx-2010.las": "",
    "real/autzen_bmx/autzen-bmx-2023.las": "",
}
RAW = (
    "terrain/coromandel_forest.laz",
    "terrain/chablais_forest.laz",
    "terrain/british_columbia_forest.laz",
    "real/ign_tiles/sample_lareunion_epsg2975.laz",
    "real/ign_tiles/alpine_slope.laz",
    "real/ign_tiles/test_data_77050_627755_LA93_IGN69.laz",
    "real/ign_tiles/test_data_77050_627760_LA93_IGN69.laz",
)


@pytest.fixture(autouse=True)
def _no_signals(monkeypatch) -> None:
    monkeypatch.setattr(cancellation, "install", lambda *_, **__: None)


@pytest.mark.parametrize("name", BARE)
def test_real_bare_surfaces_are_taken(shared_data, name):
    refuse_raw([shared_data / name], "auto", InputParameters(crs=BARE[name]))


@pytest.mark.parametrize("name", RAW)
def test_real_raw_surveys_are_refused(shared_data, name):
    path = shared_data / name
    with pytest.raises(InputError, match=r"is no bare ground \(\d+ %.*slopewatch ground.*--ground as_is"):
        refuse_raw([path], "auto")
    refuse_raw([path], "as_is")
    refuse_raw([path], "class_2")


@pytest.mark.parametrize("name", [name for name in RAW if "lareunion" not in name])
def test_the_ground_of_real_surveys_is_bare_by_its_shape_too(shared_data, name):
    cloud = read_cloud(shared_data / name)
    share = thick_share(cloud.xyz[cloud.classification == 2])
    assert np.isnan(share) or share < 0.02


def test_rough_rock_that_is_thinned_is_no_plant(shared_data):
    rock = read_cloud(shared_data / "real/lone-star.copc.laz", InputParameters(crs=LONE_STAR)).xyz
    shares = np.array([thick_share(rock[::step]) for step in (1, 3, 10, 30)])
    assert not (shares > 0.12).any(), shares
    assert (shares[:2] > 0.01).all()  # it is rough, and it is measured


@pytest.fixture(scope="module", params=[0.2, 0.7])
def simulated(request) -> SimulatedPair:
    size = {"points": 50_000, "length": 20.0, "height": 10.0}
    return simulate_pair(SurveyParameters(seed=3, vegetation=request.param, **size))


def write(path: Path, xyz: np.ndarray, *, classes=1, returns=(1, 1)) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz[0])
    header.add_crs(CRS.from_epsg(32651))
    las = laspy.LasData(header)
    las.xyz = xyz
    las.return_number, las.number_of_returns = (np.full(len(xyz), r) if np.isscalar(r) else r for r in returns)
    las.classification = np.full(len(xyz), classes) if np.isscalar(classes) else classes
    las.write(path)
    return path


def test_simulated_surveys_and_their_ground(simulated, tmp_path):
    cloud = simulated.first
    ground = cloud.truth_ground > 0
    returns = (cloud.return_number, cloud.number_of_returns)
    raw = bareness(write(tmp_path / "raw.laz", cloud.xyz, returns=returns))
    assert raw.followed > 0.05
    assert raw.signs()
    bare = bareness(write(tmp_path / "ground.laz", cloud.xyz[ground], returns=[r[ground] for r in returns]))
    assert bare.signs() == []
    assert bare.thick < 0.01
    if simulated.parameters.vegetation > 0.5:  # by its shape alone where a scanner counts no returns
        single = bareness(write(tmp_path / "single.laz", cloud.xyz))
        assert single.followed == 0
        assert single.thick > 0.3


@pytest.mark.parametrize("dip", [0, 45, 80, 90])
def test_a_sheet_is_a_sheet_at_every_inclination(dip):
    rng = np.random.default_rng(2)
    u, v, out = rng.uniform(0, 20, 40_000), rng.uniform(0, 10, 40_000), rng.normal(0, 0.03, 40_000)
    s, c = np.sin(np.radians(dip)), np.cos(np.radians(dip))
    assert thick_share(np.column_stack([u, v * c - out * s, v * s + out * c])) == 0


def test_an_edge_is_no_plant_and_a_filled_hedge_is():
    rng = np.random.default_rng(2)
    x, y, z = rng.uniform(0, 1, (3, 60_000)) * [[10], [4], [4]]
    steps = np.column_stack([x, np.where(y > z, np.ceil(y), y), np.where(y > z, z, np.ceil(z))])
    assert thick_share(steps) < 0.05
    assert thick_share(np.column_stack([x, y, z])) > 0.9


def test_a_cloud_too_thin_to_tell():
    rng = np.random.default_rng(2)
    assert np.isnan(thick_share(rng.uniform(0, 50, (2500, 3))))
    assert Bareness(thick=float("nan"), followed=0.0, plants=0.0, ground=0.0).signs() == []


def test_what_the_file_says_itself(tmp_path):
    rng = np.random.default_rng(2)
    xyz = np.column_stack([rng.uniform(0, 20, (2, 8000)).T, rng.normal(0, 0.02, 8000)]) + [5e5, 3.5e6, 50]
    named = bareness(write(tmp_path / "a.laz", xyz, classes=rng.choice([2, 4], 8000)))
    assert named.signs() == [f"{100 * named.plants:.0f} % of its points have the classes of plants"]
    filled = rng.uniform(0, 10, (20_000, 3)) + [5e5, 3.5e6, 50]
    assert bareness(write(tmp_path / "b.laz", filled, classes=2)).signs() == []  # all of it is ground
    assert bareness(write(tmp_path / "c.laz", filled, classes=1)).signs()
    noise = np.where(rng.random(8000) < 0.4, 18, 1)
    xyz[noise == 18] += rng.uniform(0, 5, (int((noise == 18).sum()), 3))
    assert bareness(write(tmp_path / "d.laz", xyz, classes=noise)).signs() == []


def test_ground_points_by_their_class(tmp_path):
    labels = np.array([1, 2, 2, 7], dtype=np.uint8)
    assert taken_as_ground(labels, "auto", Path("a.laz")) is None
    assert taken_as_ground(labels[1:3], "class_2", Path("a.laz")) is None
    assert taken_as_ground(labels, "class_2", Path("a.laz")).tolist() == [False, True, True, False]
    with pytest.raises(InputError, match=r"'a\.laz' has no points of class 2; extract"):
        taken_as_ground(labels[:1], "class_2", Path("a.laz"))


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(cli, [str(a) for a in arguments])
    return result.exit_code, " ".join(result.output.split())


def arguments_of(command: str, first: Path, second: Path, folder: Path) -> list[object]:
    return {
        "change": ["change", first, second, "--output-dir", folder, "--cell", 0.5],
        "m3c2": ["m3c2", first, second, "--output", folder / "out.laz"],
        "register": ["register", first, second, "--output", folder / "out.laz"],
    }[command]


COMMANDS = ("change", "m3c2", "register")


@pytest.fixture(scope="module")
def surveys(tmp_path_factory) -> tuple[Path, Path]:
    """Ground of class 2, a third of it lowered by 0.3 m in the later one, under plants of class 1 that grow."""
    folder = tmp_path_factory.mktemp("surveys")
    made = []
    for number, (day, deep) in enumerate((("2024-05-01", 0.0), ("2025-05-01", 0.3)), 1):
        rng = np.random.default_rng(number)
        x, y = rng.uniform(0, 15, (2, 12_000))
        z = 0.5 * y + 0.3 * np.sin(x) + rng.normal(0, 0.01, len(x)) - np.where(x < 5, deep, 0)
        ground = np.column_stack([x, y, z])
        plants = ground[rng.random(len(x)) < 0.6]
        plants = plants + [0, 0, 1] * rng.uniform(0.1, 1.0 + number, (len(plants), 1))
        xyz = np.concatenate([plants, ground]) + [5e5, 3.5e6, 50]
        labels = np.r_[np.ones(len(plants)), np.full(len(ground), 2)]
        order = rng.permutation(len(xyz))
        made.append(write(folder / f"{day}.laz", xyz[order], classes=labels[order].astype(np.uint8)))
    return made[0], made[1]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_raw_survey_is_refused_before_any_work(surveys, tmp_path, command):
    code, said = run(*arguments_of(command, *surveys, tmp_path))
    assert code == 2, said
    for word in ("2024-05-01.laz", "is no bare ground", "slopewatch ground", "slopewatch inspect"):
        assert word in said
    assert "or give --ground class_2 to take the points of class 2, or --ground as_is if it is a bare surface." in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_a_later_survey_that_is_raw_is_refused_too(surveys, tmp_path, command):
    cloud = laspy.read(surveys[0])
    cloud.points = cloud.points[np.asarray(cloud.classification) == 2]
    cloud.write(tmp_path / "2024-05-01.laz")
    code, said = run(*arguments_of(command, tmp_path / "2024-05-01.laz", surveys[1], tmp_path))
    assert code == 2
    assert "2025-05-01.laz' is no bare ground" in said


@pytest.mark.parametrize("command", COMMANDS)
def test_a_surface_that_looks_raw_can_be_taken_as_it_is(surveys, tmp_path, command):
    code, said = run(*arguments_of(command, *surveys, tmp_path), "--ground", "as_is")
    assert code == 0, said
    record = json.loads(next(tmp_path.glob("*run.json")).read_text())
    assert record["parameters"]["surface"] == {"ground": "as_is"}


def test_the_change_of_points_of_class_2(surveys, tmp_path):
    code, said = run(*arguments_of("change", *surveys, tmp_path), "--ground", "class_2")
    assert code == 0, said
    assert json.loads((tmp_path / "run.json").read_text())["metrics"]["largest_sink_m"] == pytest.approx(-0.3, abs=0.02)


def test_distances_of_points_of_class_2(surveys, tmp_path):
    code, said = run(*arguments_of("m3c2", *surveys, tmp_path), "--ground", "class_2")
    assert code == 0, said
    found = laspy.read(tmp_path / "out.laz")
    assert set(np.unique(found.classification)) == {2}
    lowered = np.asarray(found.x) - 5e5 < 4
    distance = np.asarray(found.m3c2_distance)
    assert np.nanmedian(distance[lowered]) == pytest.approx(-0.3 * np.cos(np.arctan(0.5)), abs=0.03)
    assert np.nanmedian(distance[np.asarray(found.x) - 5e5 > 6]) == pytest.approx(0, abs=0.02)


def test_a_registration_by_points_of_class_2_moves_all(surveys, tmp_path):
    first = laspy.read(surveys[0])
    raw = np.array(first.xyz)
    moved = write(tmp_path / "moved.laz", raw + [0.1, -0.05, 0.08], classes=np.array(first.classification))
    code, said = run(*arguments_of("register", surveys[0], moved, tmp_path), "--ground", "class_2")
    assert code == 0, said
    aligned = laspy.read(tmp_path / "out.laz")
    assert np.abs(np.asarray(aligned.xyz) - raw).max() < 0.01
    assert np.array_equal(aligned.classification, first.classification)


def test_a_known_motion_is_applied_to_a_raw_survey(surveys, tmp_path):
    code, said = run(
        *arguments_of("register", *surveys, tmp_path), "--ground", "class_2", "--transform", tmp_path / "t.json"
    )
    assert code == 0, said
    code, said = run("register", *surveys, "--apply", tmp_path / "t.json", "--output", tmp_path / "again.laz")
    assert code == 0, said
    assert np.array_equal(laspy.read(tmp_path / "again.laz").xyz, laspy.read(tmp_path / "out.laz").xyz)
