"""Ground extraction against PDAL's filters, on clouds whose ground is known."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from ...engine.core.version import VERSION
from ...engine.pointcloud.pdal_program import find_pdal
from .ground_clouds import CASES, Cloud
from .ground_figures import measured
from .ground_methods import write_las
from .peer_case import Case, Judged, Tool, own_tool
from .peers import PeerMissingError

QUICK_SIDE_M = 30.0
CLOUDS = ("native_forest", "chablais_forest")
"""A simulated plot and a real cloud with its vendor's ground, by their names in ``ground_clouds``."""
OWN = """
import json, sys, time
import laspy, numpy as np
from slopewatch.engine.ground.filtering import ground_mask
from slopewatch.interface.parameters import GroundParameters
folder, profile = sys.argv[1], "PROFILE"
las = laspy.read(f"{folder}/given.las")
xyz, last = np.array(las.xyz), np.asarray(las.return_number == las.number_of_returns)
started, cpu = time.perf_counter(), work()
mask = ground_mask(xyz, GroundParameters.build(profile=profile), last)
taken = time.perf_counter() - started, work() - cpu
np.save(f"{folder}/found/mask.npy", mask)
print(json.dumps({"seconds": taken[0], "cpu": taken[1]}))
"""
WORK = """
import resource
def work():
    who = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    return sum(used.ru_utime + used.ru_stime for used in map(resource.getrusage, who))
"""


def cases(quick: bool) -> list[Case]:
    """Each cloud with SlopeWatch, the Cloth Simulation Filter alone as published, and two filters of PDAL."""
    tools = (
        own_tool("SlopeWatch ground", VERSION, WORK + OWN.replace("PROFILE", "default")),
        own_tool("CSF as published (profile paper)", "1.1.7", WORK + OWN.replace("PROFILE", "paper"), peer=True),
        _pdal("PDAL filters.smrf", {"type": "filters.smrf"}),
        _pdal("PDAL filters.pmf", {"type": "filters.pmf"}),
    )
    return [
        Case("ground", case.title.replace(", 3 plots", ""), _prepared(case.make, quick), _judge, tools)
        for case in CASES
        if case.name in CLOUDS and not case.missing
    ]


def _prepared(make: Callable[[], tuple[Cloud, ...]], quick: bool) -> Callable[[Path], Cloud]:
    def prepare(folder: Path) -> Cloud:
        cloud = make()[0]
        if quick:
            corner = np.median(cloud.seen.xyz[:, :2], axis=0) - QUICK_SIDE_M / 2
            offset = cloud.seen.xyz[:, :2] - corner
            cloud = cloud.part(np.asarray(((offset >= 0) & (offset < QUICK_SIDE_M)).all(axis=1)))
        write_las(folder / "given.las", cloud.seen)
        return cloud

    return prepare


def _pdal(name: str, stage: Mapping[str, Any]) -> Tool:
    """A filter between reading and writing; without it the same file is read and written."""
    program = find_pdal()

    def command(folder: Path, stages: list[Mapping[str, Any]]) -> list[str]:
        if program.path is None:
            raise PeerMissingError("there is no pdal program here")
        output = {"type": "writers.las", "filename": str(folder / "found" / "labelled.las"), "forward": "all"}
        pipeline = folder / f"pipeline_{len(stages)}.json"
        reader = {"type": "readers.las", "filename": str(folder / "given.las")}
        pipeline.write_text(json.dumps([reader, *stages, {**output, "minor_version": 4}]), encoding="utf-8")
        return [str(program.path), "pipeline", str(pipeline)]

    return Tool(name, program.version, lambda folder: command(folder, [stage]), lambda folder: command(folder, []))


def _judge(truth: Cloud, found: Path, printed: Mapping[str, Any]) -> Judged:
    """Heights of what was found over the known ground: their mean magnitude decides."""
    if (found / "mask.npy").exists():
        mask = np.load(found / "mask.npy")
    else:
        mask = np.asarray(laspy.read(found / "labelled.las").classification) == 2
    figures = measured([truth], [mask])
    error = float(np.abs(truth.above[mask]).mean()) if mask.any() else float("nan")
    text = (
        f"{100 * error:.1f} cm mean height error; 99 % {100 * figures.p99:.0f} cm; recall {figures.recall:.3f}; "
        f"cells {100 * figures.covered:.0f} %"
    )
    return Judged(100 * error, text)
