"""Parameters of a batch: many slopes at once."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import AUTO, ParameterSet, _parameter


@dataclass(frozen=True)
class BatchParameters(ParameterSet, record_name="batch"):
    """How the slopes of a corridor are worked on."""

    workers: int = _parameter(
        1,
        "Slopes at the same time",
        "Each is worked on in a process of its own, as long as their memory fits the budget. 0: one after the other in "
        "the engine's own process.",
        bounds=(0, 1024),
    )
    memory_budget: float | str = _parameter(
        AUTO,
        "Memory budget",
        "Slopes start while the sum of what they are estimated to need fits; one that needs more runs alone. auto: "
        "half of the machine's memory, or of the memory of a cluster's workers.",
        kind=float,
        unit="GB",
        bounds=(0.1, 1_000_000.0),
    )
    two_surveys: str = _parameter(
        "inspect",
        "Slopes with two surveys",
        "inspect: change, volumes and screening of the last survey. series: velocities and alert levels, and a third "
        "survey is then added without computing the first two again. Slopes with more surveys are always a series.",
        choices=("inspect", "series"),
    )
    retries: int = _parameter(
        5,
        "Retries",
        "How often a slope is tried again whose process was killed or ran out of memory. What fails for another reason "
        "is not tried again in the same run.",
        bounds=(0, 100),
        advanced=True,
    )
    retry_failed: bool = _parameter(
        True,
        "Try failed slopes again",
        "Slopes that failed in an earlier run with the same input are tried again. Off: they stay failed until their "
        "input, a setting or the version changes.",
        advanced=True,
    )
    scheduler: str = _parameter(
        "",
        "Dask scheduler",
        "Works on the slopes with Dask: an address such as tcp://10.0.0.1:8786, local for a cluster of processes on "
        "this machine, or a JSON file that describes a cluster for dask-jobqueue. Empty: without Dask.",
        advanced=True,
    )
    dashboard: bool = _parameter(
        False,
        "Dask's dashboard",
        "Shows the page of tasks of a cluster that the batch starts itself.",
        advanced=True,
    )
    dashboard_address: str = _parameter(
        "127.0.0.1:8787",
        "Address of the dashboard",
        "Host and port of that page. The default can be reached from this machine only; the page has no password.",
        advanced=True,
    )
