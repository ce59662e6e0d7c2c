"""A folder with results is replaced only where that is asked for, and what people entered in it stays."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from slopewatch.engine.vector.geopackage import read_layer
from slopewatch.engine.zones.earlier_reviews import NOT_CARRIED
from slopewatch.tests.builders.clouds import write_sunk_slope
from slopewatch.tests.builders.program import run
from slopewatch.tests.builders.zone_layers import enter

ALL_COMMANDS = (
    ("inspect",), ("change",), ("series",), ("batch",), ("m3c2",), ("displacement",), ("train",),
    ("simulate", "survey"), ("simulate", "series"), ("simulate", "scenes"), ("topview",), ("suggestroi",), ("locate",),
    ("exportlabelstudio",), ("importlabelstudio",), ("demchange",), ("exportgis",), ("createproject",), ("planflight",),
    ("compareflight",),
)  # fmt: skip
REFUSED = re.compile(r"Error: The folder (\S+) holds (?:results already|another series) .*--overwrite to replace \w+\.")


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def refused(folder: Path, *arguments: object) -> None:
    """In one sentence with exit code 2, and nothing is touched."""
    before = bytes_of(folder)
    done = run(*arguments)
    assert done.returncode == 2, done.stderr
    found = REFUSED.fullmatch(done.stderr.strip())
    assert found, done.stderr
    assert found[1] == str(folder)
    assert bytes_of(folder) == before


def made(*arguments: object) -> str:
    done = run(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.fixture(scope="module")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """A slope whose western third sinks, and sinks more."""
    folder = tmp_path_factory.mktemp("clouds")
    days = (("2024-05-01", 0.0), ("2025-05-01", 0.2), ("2026-05-01", 0.4))
    first, second, third = (write_sunk_slope(folder / f"{day}.laz", lowered=depth) for day, depth in days)
    return first, second, third


@pytest.mark.parametrize("command", ALL_COMMANDS, ids=" ".join)
def test_every_command_with_an_output_folder_offers_it(command: tuple[str, ...]) -> None:
    assert "--overwrite / --no-overwrite" in run("parameters", *command).stdout


def test_a_change_made_again_keeps_the_reviews(clouds: tuple[Path, Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    common = ["--cell", 0.25, "--registration-error", 0.002, "--no-adaptive", "--output-dir", out]
    made("change", *clouds[:2], *common)
    enter(out / "zones.gpkg", "Z001", review_status="confirmed", reviewer="A. Sato", remarks="crack <b> at the berm")
    assert "A. Sato" not in (out / "report.html").read_text(encoding="utf-8")
    made("report", out)
    words = "Review: Confirmed by A. Sato. crack &lt;b&gt; at the berm"
    assert words in " ".join((out / "report.html").read_text(encoding="utf-8").split())
    refused(out, "change", *clouds[:2], *common)
    # other cells, another survey
    shown = made("change", clouds[0], clouds[2], *common, "--cell", 0.4, "--overwrite")
    assert "What was entered for one zone of the earlier results was carried over." in shown
    zones = read_layer(out / "zones.gpkg", "zones")
    assert zones.loc[0, ["review_status", "reviewer", "remarks", "epoch_to"]].tolist() == [
        "confirmed", "A. Sato", "crack <b> at the berm", "2026-05-01",
    ]  # fmt: skip
    assert words in " ".join((out / "report.html").read_text(encoding="utf-8").split())
    record = json.loads((out / "run.json").read_text())
    assert record["reviews"] == {"carried": 1, "in_remarks": 0, "split": 0, "not_carried": 0}
    # a run that fails leaves all as it was
    broken = tmp_path / "2025-05-01.laz"
    broken.write_bytes(clouds[1].read_bytes()[:50_000])
    before = bytes_of(out)
    assert run("change", clouds[0], broken, *common, "--overwrite").returncode == 2
    assert bytes_of(out) == before
    # and one that finds no zone there keeps the review next to its own results
    shown = made("change", clouds[0], clouds[1], *common, "--overwrite", "--minimum-area", 500)
    assert "could not be carried over" in shown
    assert read_layer(out / NOT_CARRIED)["reviewer"].tolist() == ["A. Sato"]
    record = json.loads((out / "run.json").read_text())
    assert record["outputs"]["reviews_not_carried"] == NOT_CARRIED
    assert [w for w in record["warnings"] if NOT_CARRIED in w]


def test_a_series_goes_on_in_its_folder_with_its_reviews(clouds: tuple[Path, Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"

    def series(*surveys: Path) -> list[object]:
        epochs = [part for path in surveys for part in ("--epoch", f"{path.stem}={path}")]
        common = ["--ground-ready", "--method", "none", "--cell", 0.5, "--no-rasters-each-survey"]
        return ["series", *epochs, *common, "--output-dir", out]

    made(*series(*clouds[:2]))
    enter(out / "series.gpkg", "S001", review_status="rejected", reviewer="B. Ito", route="R9", chain_from=120.5)
    shown = made(*series(*clouds))
    assert "carried over" in shown
    zones = read_layer(out / "series.gpkg", "zones").set_index("zone_id")
    assert zones.loc["S001", ["review_status", "reviewer", "route", "chain_from", "n_epochs"]].tolist() == [
        "rejected", "B. Ito", "R9", 120.5, 3,
    ]  # fmt: skip
    page = " ".join((out / "report.html").read_text(encoding="utf-8").split())
    assert "Review: Rejected by B. Ito." in page
    refused(out, *series(clouds[0], clouds[2]))
    made(*series(clouds[0], clouds[2]), "--overwrite")
    assert read_layer(out / "series.gpkg", "zones")["reviewer"].tolist() == ["B. Ito"]


def test_an_inspection_made_again_keeps_the_reviews_of_its_zones_and_of_the_screened_ones(tmp_path: Path) -> None:
    pair = tmp_path / "pair"
    size = ["--points", 60000, "--length", 16, "--height", 8, "--vegetation", 0.2, "--amplitude", 0.4]
    made("simulate", "survey", *size, "--output-dir", pair)
    refused(pair, "simulate", "survey", *size, "--output-dir", pair)
    epochs = [part for day in ("2024-05-01", "2025-05-01") for part in ("--epoch", f"{day}={pair / day}.laz")]
    out = tmp_path / "out"
    flow = ["inspect", *epochs, "--roi", pair / "roi.gpkg", "--output-dir", out, "--cell", 0.25]
    flow += ["--screening-method", "residual", "--residual-threshold", 0.05]
    made(*flow)
    files = {"zones.gpkg": "Z", "screened_zones.gpkg": "H"}
    before = {}
    for name in files:
        for number, zone in enumerate(read_layer(out / name, "zones")["zone_id"]):
            enter(out / name, zone, review_status="confirmed", reviewer=f"{zone} {number}", remarks=f"seen {zone}.")
        before[name] = read_layer(out / name, "zones")
        assert len(before[name]) >= 2
    refused(out, *flow)
    # cells half as large
    made(*[0.2 if part == 0.25 else part for part in flow], "--overwrite")
    kept = read_layer(out / NOT_CARRIED) if (out / NOT_CARRIED).exists() else None
    for name, old in before.items():
        said = " ".join(read_layer(out / name, "zones")["remarks"])
        left = [] if kept is None else kept.loc[kept["from_file"] == name, "remarks"].tolist()
        for zone in old["zone_id"]:
            assert (f"seen {zone}." in said) != (f"seen {zone}." in left), zone
        assert len(left) < len(old) / 2


def test_rasters_of_m3c2_and_a_model_are_results_too(clouds: tuple[Path, Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "run.json").touch()  # of another command: it is not touched
    line = ["m3c2", *clouds[:2], "--output", tmp_path / "cores.laz", "--output-dir", out, "--registration-error", 0.002]
    made(*line, "--core-spacing", 1.0)
    refused(out, *line)
    model = tmp_path / "model"
    model.mkdir()
    (model / "model.safetensors").touch()
    refused(model, "train", clouds[0], "--start", "none", "--output-dir", model)
