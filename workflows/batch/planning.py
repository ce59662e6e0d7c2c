"""From slopes to jobs: their tasks' ids and folders; and which need no work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...engine.epochs.epoch import Epoch
from ...engine.epochs.manifest import check_series
from ...interface.parameters import BatchParameters, InputParameters
from ..layer_files import NO_LAYERS, LayerFiles
from .folder_names import folder_name
from .jobs import Job, Problem, Slope
from .results import SlopeResult, result_of
from .settings import command_of, effective, options_of
from .state import FAILED, Entry
from .task_ids import FileHashes, task_id

SLOPES = "slopes"
"""Folder of the slopes' results in the output folder."""


@dataclass
class Plan:
    """``jobs`` (by slope) are all slopes that can be worked on, ``waiting`` those that are to be.

    ``done`` have their results already; ``problems`` are why others cannot be worked on.
    """

    jobs: dict[str, Job] = field(default_factory=dict)
    waiting: list[Slope] = field(default_factory=list)
    done: dict[str, SlopeResult] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)


@dataclass(frozen=True)
class Common:
    """What all slopes share: settings given for all, the profile, the alert table, PDAL, the batch's parameters, and
    the layers that a slope need not have its own of.
    """

    options: Mapping[str, Any]
    profile: str
    alerts: Path | None
    pdal: Path | None
    parameters: BatchParameters
    layers: LayerFiles = NO_LAYERS


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
    settings = _EffectiveSettings()
    for number, slope in enumerate(slopes):
        progress.update(number / len(slopes), f"reading {slope.name}")
        try:
            job = _job(slope, output_dir, common, hashes, settings)
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
            found.waiting.append(slope)
        except InputError as error:
            found.problems.append(Problem(slope.name, str(error)))
    hashes.save()
    return found


class _EffectiveSettings:
    """Every setting of a command with its value; most slopes of a corridor have the same, which are built once."""

    def __init__(self) -> None:
        self._known: dict[str, dict[str, Any]] = {}

    def of(self, command: str, options: Mapping[str, Any], profile: str) -> dict[str, Any]:
        """See ``effective``."""
        key = repr((command, sorted(options.items()), profile))  # 1, 1.0 and True are not the same
        if key not in self._known:
            self._known[key] = effective(command, options, profile)
        return self._known[key]


def _of_corridor(slope: Slope, common: Common, options: Mapping[str, Any], profile: str) -> Path | None:
    """The corrections given for the whole corridor, if some of them lie on the slope.

    Raises:
        InputError: they cannot be used.
    """
    path, epochs = common.layers.corrections, [Epoch(survey.cloud, survey.day) for survey in slope.surveys]
    if path is None:
        return None
    from ..corrections import lie_on  # its libraries take longer to load than a finished corridor to look at

    return path if lie_on(path, epochs, slope.roi, InputParameters.build(options, profile)) else None


def _job(slope: Slope, output_dir: Path, common: Common, hashes: FileHashes, settings: _EffectiveSettings) -> Job:
    """The job of a slope.

    Raises:
        InputError: a file cannot be read, a cloud is there twice, or settings do not go together.
    """
    command = command_of(slope, common.parameters.two_surveys)
    options = options_of(slope, command, common.options)
    profile = slope.profile or common.profile
    alerts = slope.alerts or common.alerts
    files = {"roi": slope.roi, "stable": slope.stable, "alerts": alerts if command == "series" else None}
    files["centreline"] = slope.centreline or common.layers.centreline
    if files["centreline"] is not None:
        files["field_names"] = common.layers.field_names
    if len(slope.surveys) > 1:
        files["classes"] = slope.classes or common.layers.classes
    files["corrections"] = slope.corrections or _of_corridor(slope, common, options, profile)
    given = {role: path for role, path in files.items() if path is not None}
    if len(slope.surveys) > 1:
        check_series([Epoch(survey.cloud, survey.day) for survey in slope.surveys])
    clouds = [(survey.day.isoformat(), hashes.of(survey.cloud)) for survey in slope.surveys]
    task = task_id(
        command, clouds, {role: hashes.of(path) for role, path in given.items()}, settings.of(command, options, profile)
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
