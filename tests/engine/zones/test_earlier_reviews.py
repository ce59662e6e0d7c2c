"""Reviews in the files of an output folder, through the end of a run that replaces them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import geopandas as gpd
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.core.staged_outputs import staged_outputs
from slopewatch.engine.vector.geopackage import read_layer
from slopewatch.engine.zones.earlier_reviews import NOT_CARRIED, EarlierReviews
from slopewatch.engine.zones.fields import FIELDS
from slopewatch.models.screening.zones import FIELDS as HAZARD_FIELDS
from slopewatch.tests.builders.zone_layers import Rectangle, connected, enter, opened, zone_layer
from slopewatch.workflows.products.zones import write_zones

A, B, C = (0.0, 0.0, 3.0, 3.0), (10.0, 0.0, 14.0, 4.0), (20.0, 0.0, 22.0, 2.0)


def run_again(
    folder: Path, files: dict[str, Sequence[Rectangle]], *, run: str = "r2", fails: bool = False
) -> tuple[dict[str, gpd.GeoDataFrame], dict, Progress]:
    """What the end of a run does: zones of ``files`` get the reviews of before; the new layers, facts and messages."""
    progress = Progress()
    reviews = EarlierReviews(folder, tuple(files))
    with staged_outputs(folder) as stage:
        for name, places in files.items():
            fields = HAZARD_FIELDS if name.startswith("screened") else FIELDS
            frame = reviews.carried_to(zone_layer(places, run=run, fields=fields), name, fields)
            write_zones(stage.path(name), frame)
        outputs: dict[str, Path] = {}
        facts = reviews.finish(stage, outputs, progress)
        if fails:
            raise RuntimeError
    assert outputs == ({"reviews_not_carried": folder / NOT_CARRIED} if (folder / NOT_CARRIED).exists() else {})
    return {name: read_layer(folder / name, "zones") for name in files}, facts, progress


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """An output folder with three reviewed zones and a reviewed screened one."""
    write_zones(tmp_path / "zones.gpkg", zone_layer([A, B, C]))
    write_zones(tmp_path / "screened_zones.gpkg", zone_layer([A], ids=["H001"], fields=HAZARD_FIELDS))
    enter(tmp_path / "zones.gpkg", "Z001", review_status="confirmed", reviewer="A. Sato", remarks="crack")
    enter(tmp_path / "zones.gpkg", "Z002", slope_id="S7", chain_from=12300.0, side="up")
    enter(tmp_path / "zones.gpkg", "Z003", review_status="rejected", remarks="a car")
    enter(tmp_path / "screened_zones.gpkg", "H001", review_status="rejected", reviewer="B. Ito")
    return tmp_path


def test_all_of_it_is_carried_over_or_kept_and_told(results: Path) -> None:
    layers, facts, progress = run_again(results, {"zones.gpkg": [B, A], "screened_zones.gpkg": [A]})
    zones = layers["zones.gpkg"]
    assert zones.loc[1, ["review_status", "reviewer", "remarks"]].tolist() == ["confirmed", "A. Sato", "crack"]
    assert zones.loc[0, ["slope_id", "chain_from", "side", "review_status"]].tolist() == [
        "S7", 12300.0, "up", "unreviewed",
    ]  # fmt: skip
    assert layers["screened_zones.gpkg"]["reviewer"].tolist() == ["B. Ito"]
    assert facts == {"carried": 3, "in_remarks": 0, "split": 0, "not_carried": 1}
    (told,) = progress.warnings
    assert told.startswith("What was entered for one zone of the earlier results could not be carried over")
    assert NOT_CARRIED in told
    kept = read_layer(results / NOT_CARRIED, "reviews")
    columns = ["zone_id", "kind", "run_id", "review_status", "remarks", "from_file", "why_not_carried"]
    assert kept[columns].to_numpy().tolist() == [
        ["Z003", "subsidence", "r1", "rejected", "a car", "zones.gpkg", "no zone of these results continues it"]
    ]
    assert kept.geometry.iloc[0].equals(zone_layer([C]).geometry.iloc[0])
    # it is for people, who may strike it out
    with opened(results / NOT_CARRIED) as database:
        database.execute("UPDATE reviews SET remarks = 'done'")


def test_what_was_kept_is_tried_again(results: Path) -> None:
    run_again(results, {"zones.gpkg": [A, B]})
    # a run of the screening alone leaves it as it is
    run_again(results, {"screened_zones.gpkg": [A]}, run="r3")
    assert read_layer(results / NOT_CARRIED)["zone_id"].tolist() == ["Z003"]
    # what nothing continues now joins what waits
    _, facts, _ = run_again(results, {"zones.gpkg": [B]}, run="r4")
    assert facts["not_carried"] == 2
    assert read_layer(results / NOT_CARRIED)["remarks"].tolist() == ["crack", "a car"]
    layers, facts, progress = run_again(results, {"zones.gpkg": [A, B, C]}, run="r5")
    assert layers["zones.gpkg"]["remarks"].tolist() == ["crack", "", "a car"]
    assert layers["zones.gpkg"]["review_status"].tolist() == ["confirmed", "unreviewed", "rejected"]
    assert (facts["carried"], facts["not_carried"], progress.warnings) == (3, 0, [])
    assert not (results / NOT_CARRIED).exists()


def test_a_run_that_fails_leaves_all_as_it_was(results: Path) -> None:
    run_again(results, {"zones.gpkg": [A, B]})
    before = {p.name: p.read_bytes() for p in results.iterdir()}
    with pytest.raises(RuntimeError):
        run_again(results, {"zones.gpkg": [A, B, C]}, fails=True)
    assert {p.name: p.read_bytes() for p in results.iterdir()} == before


def test_a_file_that_cannot_be_read_is_said_before_any_work_and_kept(results: Path) -> None:
    (results / "zones.gpkg").write_bytes(b"no GeoPackage" * 100)
    with pytest.raises(InputError, match=r"zones\.gpkg cannot be read, so what was entered in it would be lost"):
        EarlierReviews(results, ("zones.gpkg",))
    EarlierReviews(results, ("screened_zones.gpkg",))
    EarlierReviews(results / "new", ("zones.gpkg",))
    with opened(results / "screened_zones.gpkg") as database:
        database.execute("ALTER TABLE zones ADD COLUMN photo BLOB")
    with pytest.raises(InputError, match=r"screened_zones\.gpkg has a column photo of binary values"):
        EarlierReviews(results, ("screened_zones.gpkg",))


def test_what_is_entered_while_the_run_is_at_work_counts(results: Path) -> None:
    """And what a program that has the file open wrote into its log, not yet into the file."""
    reviews = EarlierReviews(results, ("zones.gpkg",))
    with closing(connected(results / "zones.gpkg")) as program:
        program.execute("PRAGMA journal_mode = WAL")
        program.execute("UPDATE zones SET remarks = 'late' WHERE zone_id = 'Z001'")
        program.commit()
        assert (results / "zones.gpkg-wal").stat().st_size
        with staged_outputs(results) as stage:
            frame = reviews.carried_to(zone_layer([A], run="r2"), "zones.gpkg", FIELDS)
            write_zones(stage.path("zones.gpkg"), frame)
        assert not (results / "zones.gpkg-wal").exists()
    assert read_layer(results / "zones.gpkg", "zones")["remarks"].tolist() == ["late"]


def test_columns_of_ones_own_last_and_measured_ones_of_another_version_do_not(results: Path) -> None:
    with opened(results / "zones.gpkg") as database:
        database.execute("ALTER TABLE zones ADD COLUMN Visits INTEGER")
        database.execute("ALTER TABLE zones ADD COLUMN Photo TEXT")
        database.execute("UPDATE zones SET Visits = 2, Photo = 'a.jpg' WHERE zone_id = 'Z003'")
    reviews = EarlierReviews(results, ("zones.gpkg",))
    older = [name for name in FIELDS if name != "n_eff"]
    frame = reviews.carried_to(zone_layer([C]).drop(columns="n_eff"), "zones.gpkg", older)
    assert "n_eff" not in frame  # which the version that wrote the file measured
    layers, _, _ = run_again(results, {"zones.gpkg": [A]})
    assert "Visits" in read_layer(results / NOT_CARRIED)
    layers, _, _ = run_again(results, {"zones.gpkg": [A, C]}, run="r3")
    zones = layers["zones.gpkg"]
    assert zones["Visits"].fillna(-1).tolist() == [-1, 2]
    assert zones["Photo"].fillna("").tolist() == ["", "a.jpg"]
    with opened(results / "zones.gpkg") as database:
        kinds = {row[1]: row[2] for row in database.execute("PRAGMA table_info(zones)")}
        assert kinds["Visits"] in ("INTEGER", "MEDIUMINT")
        database.execute("UPDATE zones SET Visits = 3")
