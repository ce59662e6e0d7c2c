"""Folders as the commands write them, one of each kind whose results are handed over, from one small bare slope."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import patch

import geopandas as gpd
import shapely
from click.testing import CliRunner
from slopewatch.cli import options
from slopewatch.cli.program import cli

COMMANDS = ("change", "m3c2", "screen", "batch", "locate", "planflight", "compareflight")
"""Those that are made here; ``handed_over`` makes those of ``demchange`` and ``displacement``."""
_DAYS = ("2024-05-01", "2025-05-01")


def call(*arguments: object) -> None:
    """Run a command of the command line in this process, which has what it imports already, and keeps its signals."""
    with patch.object(options.cancellation, "install"):
        done = CliRunner().invoke(cli, [*map(str, arguments), "--progress", "none"])
    assert done.exit_code == 0, (arguments, done.output, done.exception)


def made(folder: Path) -> dict[str, Path]:
    """The folder of a finished run by command; the batch has a slope with two surveys and one with a single one."""
    survey = folder / "survey"
    call("simulate", "survey", "--points", 12000, "--length", 12, "--height", 5, "--vegetation", 0, "--offset", 0,
         "--output-dir", survey)  # fmt: skip
    first, later = (survey / f"{day}.laz" for day in _DAYS)
    region = survey / "roi.gpkg"
    road, found = _road(folder, region), {name: folder / name for name in COMMANDS}
    call("change", first, later, "--cell", 0.25, "--centreline", road, "--output-dir", found["change"])
    found["m3c2"].mkdir()
    call("m3c2", first, later, "--output", found["m3c2"] / "points.laz")
    found["screen"].mkdir()
    call("screen", later, "--method", "relief", "--output", found["screen"] / "screened.laz")
    call("batch", _manifest(folder, survey, road), "--ground-ready", "--cell", 0.5, "--no-displacement",
         "--screening-method", "relief", "--workers", 0, "--output-dir",
         found["batch"])  # fmt: skip
    found["locate"].mkdir()
    call("locate", found["change"] / "zones.gpkg", "--centreline", road, "--output", found["locate"] / "located.gpkg")
    call("planflight", first, "--roi", region, "--pulse-rate", 2000, "--output-dir", found["planflight"])
    call("compareflight", found["planflight"] / "plan.gpkg", later, "--ground", later, "--output-dir",
         found["compareflight"])  # fmt: skip
    return found


def _road(folder: Path, region: Path) -> Path:
    """A straight axis 10 m south of the slope."""
    area = gpd.read_file(region)
    west, south, east, _ = area.total_bounds
    line = shapely.LineString([(west - 50, south - 10), (east + 50, south - 10)])
    gpd.GeoDataFrame({"route": ["S1"]}, geometry=[line], crs=area.crs).to_file(folder / "road.gpkg")
    return folder / "road.gpkg"


def _manifest(folder: Path, survey: Path, road: Path) -> Path:
    rows = [f"{slope},{day},{survey / day}.laz,{road}" for slope, day in
            (("B pair", _DAYS[0]), ("B pair", _DAYS[1]), ("A one", _DAYS[0]))]  # fmt: skip
    path = folder / "corridor.csv"
    path.write_text("\n".join(["slope,date,file,centreline", *rows]) + "\n", encoding="utf-8")
    return path
