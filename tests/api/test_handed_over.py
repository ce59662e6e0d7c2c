"""The API of what is done with finished runs: the same as the commands write."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import geopandas as gpd
import pytest
from slopewatch import api
from slopewatch.tests.builders.handed_over import FEW_POINTS, pit
from slopewatch.tests.builders.planes import write_plane
from slopewatch.tests.builders.program import run
from slopewatch.workflows import createproject


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of ``demchange`` with one zone."""
    return pit(tmp_path_factory.mktemp("models"))


def test_an_archive_is_that_of_the_command(folder, tmp_path):
    names = tmp_path / "names.csv"
    names.write_text("ours,theirs\nzone_id,ASSET_REF\n", encoding="utf-8")
    given = {"fields": names, "surface_points": FEW_POINTS, "organisation": "Road office"}
    made = api.export_gis(folder, tmp_path / "api.zip", **given)
    options = ["--fields", names, "--surface-points", FEW_POINTS, "--organisation", "Road office"]
    done = run("exportgis", folder, "--output", tmp_path / "cli.zip", *options, "--progress", "none")
    assert done.returncode == 0, done.stderr
    one, two = (hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() for name in ("api.zip", "cli.zip"))
    assert one == two
    assert made.outputs["handover"] == tmp_path / "api.zip"
    layer = gpd.read_file(f"/vsizip/{made.outputs['handover']}/layers.gpkg", layer="zones")
    assert len(layer["ASSET_REF"]) == 1
    with pytest.raises(api.InputError, match="Neither --output nor --to"):
        api.export_gis(folder)
    with pytest.raises(api.InputError, match="is no address of a database"):
        api.export_gis(folder, to="mysql://road@host/assets")


def test_a_report_is_made_again_as_a_pdf_with_its_details(folder):
    made = api.report(folder, pdf=True, client="Road Directorate", zone_profiles=0)
    assert made.outputs["report_pdf"].read_bytes().startswith(b"%PDF")
    record = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert record["parameters"]["details"]["client"] == "Road Directorate"
    with pytest.raises(api.InputError, match=r"clint is no parameter here; did you mean client\?"):
        api.report(folder, clint="Road Directorate")


def test_a_corridor_has_the_results_of_each_slope_and_those_that_failed(tmp_path):
    for number, day in enumerate(("2024-05-01", "2025-05-01"), 1):
        write_plane(tmp_path / f"{day}.laz", seed=number, raised=(8.0, 8.0, 3.0, 0.3 * (number - 1)))
    rows = ["slope,date,file", "S1,2024-05-01,2024-05-01.laz", "S1,2025-05-01,2025-05-01.laz", "S2,2025-05-01,none.laz"]
    (tmp_path / "corridor.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    manifest, given = tmp_path / "corridor.csv", {"method": "none", "two_surveys": "series", "displacement": False}
    made = api.batch(manifest, tmp_path / "out", cell=0.5, workers=0, ground_ready=True, **given)
    assert (made.figures["slopes"], made.figures["slopes_failed"]) == (2, 1)
    zones = gpd.read_file(made.outputs["corridor"], layer="zones")
    assert zones["slope"].tolist() == ["S1"]
    record = json.loads((tmp_path / "out/slopes/S1/series/run.json").read_text(encoding="utf-8"))
    assert record["parameters"]["change"]["cell"] == 0.5
    with pytest.raises(api.InputError, match="cell is -3"):
        api.batch(manifest, tmp_path / "other", cell=-3.0)
    assert not (tmp_path / "other").exists()


def test_a_project_is_asked_of_qgis_as_by_the_command(folder, tmp_path, monkeypatch):
    asked: dict[str, Any] = {}

    def asked_of_qgis(program: Path, algorithm: str, given: dict[str, str], environ: dict[str, str]) -> dict[str, int]:
        asked.update(given, algorithm=algorithm)
        Path(given["OUTPUT"]).write_bytes(b"project")
        return {"LAYERS": 7}

    monkeypatch.setattr(createproject, "find_qgis_process", lambda: Path("qgis_process"))
    monkeypatch.setattr(createproject, "run_algorithm", asked_of_qgis)
    made = api.create_project(folder, tmp_path / "slope.qgz", project_title="Slope 12", paper="A3")
    assert made.outputs["project"] == tmp_path / "slope.qgz"
    assert made.figures["layers"] == 7
    assert (asked["algorithm"], asked["INPUT"], asked["PROJECT_TITLE"], asked["PAPER"]) == (
        "createproject", str(folder), "Slope 12", "A3",
    )  # fmt: skip
    with pytest.raises(api.InputError, match="holds results already"):
        api.create_project(folder, tmp_path / "slope.qgz")
