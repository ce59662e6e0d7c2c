"""From slopes to jobs: their tasks' ids, their folders, the memory they need; and which need no work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...engine.epochs.epoch import Epoch
from ...engine.epochs.manifest import check_series
from ...interface.parameters import BatchParameters
from .estimate import slope_memory
from .jobs import Job, Problem, Slope
from .regions import folder_name
from .results import SlopeResult, result_of
from .settings import command_of, effective, group_of, options_of
from .state import FAILED, Entry
from .task_ids import FileHashes, task_id

SLOPES = "slopes"
"""Folder of the slopes' results in the output folder."""


@dataclass
class Plan:
    """``jobs`` (by slope) are all slopes that can be worked on, ``needs`` the bytes of those that are to be.

    ``done`` have their results already; ``problems`` are why others cannot be worked on.
    """

    jobs: dict[str, Job] = field(default_factory=dict)
    needs: dict[str, int] = field(default_factory=dict)
    done: dict[str, SlopeResult] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)


@dataclass(frozen=True)
class Common:
    """What all slopes share: settings given for all, the profile, the alert table, PDAL, and the batch's parameters."""

    options: Mapping[str, Any]
    profile: str
    alerts: Path | None
    pdal: Path | None
    parameters: BatchParameters


def plan(
    slopes: Sequence[Slope],
    output_dir: Path,
    common: Common,
    hashes: FileHashes,
    entries: Mapping[str, Entry],
    progress: Progress,
) -> Plan:
    """What is to be done for each slope. Nothing is written but the hashes.

    Args:
        entries: the states of an earlier run.
    """
    found = Plan()
    for number, slope in enumerate(slopes):
        progress.update(number / len(slopes), f"reading {slope.name}")
        try:
            job = _job(slope, output_dir, common, hashes)
            found.jobs[slope.name] = job
            result = result_of(job)
            if result is not None:
                found.done[slope.name] = result
                continue
            before = entries.get(slope.name)
            failed = before is not None and before.task == job.task and before.state == FAILED
            if before is not None and failed and not common.parameters.retry_failed:
                found.problems.append(Problem(slope.name, before.sentence))
                continue
            groups = group_of(job.command, job.options, job.profile)
            found.needs[slope.name] = slope_memory(slope, job.command, groups)
        except InputError as error:
            found.problems.append(Problem(slope.name, str(error)))
    hashes.save()
    return found


def _job(slope: Slope, output_dir: Path, common: Common, hashes: FileHashes) -> Job:
    """The job of a slope.

    Raises:
        InputError: a file cannot be read, a cloud is there twice, or settings do not go together.
    """
    command = command_of(slope, common.parameters.two_surveys)
    options = options_of(slope, command, common.options)
    profile = slope.profile or common.profile
    alerts = slope.alerts or common.alerts
    files = {"roi": slope.roi, "stable": slope.stable, "alerts": alerts if command == "series" else None}
    given = {role: path for role, path in files.items() if path is not None}
    if len(slope.surveys) > 1:
        check_series([Epoch(survey.cloud, survey.day) for survey in slope.surveys])
    clouds = [(survey.day.isoformat(), hashes.of(survey.cloud)) for survey in slope.surveys]
    task = task_id(
        command, clouds, {role: hashes.of(path) for role, path in given.items()}, effective(command, options, profile)
    )
    return Job(
        task,
        slope.name,
        command,
        tuple((survey.day.isoformat(), str(survey.cloud)) for survey in slope.surveys),
        {role: str(path) for role, path in given.items()},
        profile,
        options,
        str(output_dir / SLOPES / folder_name(slope.name) / command),
        str(common.pdal.absolute()) if common.pdal else "",
    )
