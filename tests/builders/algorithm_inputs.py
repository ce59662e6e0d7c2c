"""What the small runs of the algorithms read, each made by the engine once, when it is first asked for."""

from __future__ import annotations

import csv
import json
import os
import subprocess
from functools import cached_property
from pathlib import Path

from qgis.core import QgsVectorLayer
from slopewatch.tests.builders import known_truth
from slopewatch.tests.builders.engine_setup import make_whole_plugin
from slopewatch.tests.builders.qgis import engine_python

SMALL = ["--points", "16000", "--length", "14", "--height", "6", "--vegetation", "0"]


class Inputs:
    """What the runs read, each made by the engine once, when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def engine(self, *arguments: object, module: str = "cli") -> None:
        command = [engine_python(), "-m", f"slopewatch.{module}", *map(str, arguments)]
        subprocess.run(command, check=True, capture_output=True)

    def known(self, kind: str, ending: str) -> list[Path]:
        """A pair with a known change, made by tests/builders/known_changes.py."""
        made = self.folder / f"known {kind}"
        made.mkdir()
        self.engine(kind, made, module="tests.builders.known_changes")
        return [made / f"{day}{ending}" for day in known_truth.DAYS]

    @cached_property
    def survey(self) -> Path:
        """Two surveys of a bare slope that fit each other, so that they are their own ground."""
        made = self.folder / "survey, 'bare'"
        self.engine("simulate", "survey", *SMALL, "--offset", "0", "--output-dir", made)
        return made

    @property
    def pair(self) -> dict[str, Path]:
        return {"REFERENCE": self.survey / "2024-05-01.laz", "CLOUD": self.survey / "2025-05-01.laz"}

    @cached_property
    def change(self) -> Path:
        """Results of the two surveys."""
        made = self.folder / "change"
        self.engine("change", *self.pair.values(), "--cell", "0.25", "--output-dir", made)
        return made

    @cached_property
    def models(self) -> list[Path]:
        """Two elevation models, the later with a bias and a pit."""
        return self.known("models", ".tif")

    @cached_property
    def moved(self) -> dict[str, Path]:
        """Two clouds of rough ground, of which the northern half moved along its surface."""
        return dict(zip(("REFERENCE", "CLOUD"), self.known("clouds", ".laz")))

    @cached_property
    def road(self) -> Path:
        """A straight axis 20 m south of the survey, from 50 m west of it to 50 m east."""
        extent = QgsVectorLayer(str(self.survey / "roi.gpkg")).extent()
        south = extent.yMinimum() - 20
        corners = [[extent.xMinimum() - 50, south], [extent.xMaximum() + 50, south]]
        line = {
            "type": "Feature",
            "properties": {"route": "S1"},
            "geometry": {"type": "LineString", "coordinates": corners},
        }
        crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32651"}}
        made = self.folder / "road.geojson"
        made.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": [line]}), encoding="utf-8")
        return made

    @cached_property
    def view(self) -> Path:
        made = self.folder / "view"
        self.engine("topview", self.pair["CLOUD"], "--output-dir", made)
        return made / "top_view.tif"

    @cached_property
    def plan(self) -> Path:
        made = self.folder / "plan"
        region = self.survey / "roi.gpkg"
        self.engine("planflight", self.pair["CLOUD"], "--roi", region, "--pulse-rate", "2000", "--output-dir", made)
        return made / "plan.gpkg"

    @cached_property
    def labelling(self) -> Path:
        """Label Studio's tasks, and an export in which each segment was taken over as a label."""
        made = self.folder / "labelling"
        region = self.survey / "roi.gpkg"
        self.engine("exportlabelstudio", self.view, "--segments", region, "--label-field", "name", "--output-dir", made)
        (task,) = json.loads((made / "tasks.json").read_text(encoding="utf-8"))
        annotation = {"id": 1, "completed_by": 1, "result": task["predictions"][0]["result"]}
        export = [{"id": 1, "data": task["data"], "annotations": [annotation]}]
        (made / "export.json").write_text(json.dumps(export), encoding="utf-8")
        return made

    @cached_property
    def scenes(self) -> Path:
        made = self.folder / "scenes"
        size = ["--count", "2", "--area", "200", "--density", "20", "--no-picture"]
        self.engine("simulate", "scenes", *size, "--output-dir", made)
        return made

    @cached_property
    def manifest(self) -> Path:
        path = self.folder / "corridor.csv"
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file)
            table.writerow(("slope", "date", "file", "roi"))
            table.writerows(("S1", cloud.stem, cloud, "") for cloud in self.pair.values())
        return path

    @cached_property
    def series(self) -> Path:
        """A folder that holds the two surveys and nothing else."""
        made = self.folder / "series"
        made.mkdir()
        for cloud in self.pair.values():
            os.link(cloud, made / cloud.name)
        return made

    @cached_property
    def wheels(self) -> Path:
        """The two tiny wheels that the lock of ``tiny_plugin`` names."""
        self.tiny_plugin  # noqa: B018
        return self.folder / "wheels"

    @cached_property
    def tiny_plugin(self) -> Path:
        return make_whole_plugin(self.folder / "tiny plugin", self.folder / "wheels")
