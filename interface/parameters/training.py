"""Parameters of training on own slopes."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import AUTO, ParameterSet, _parameter


@dataclass(frozen=True)
class FineTuneParameters(ParameterSet, record_name="training"):
    """Training a screening model on one's own labelled clouds."""

    start: str = _parameter(
        "shipped",
        "Start from",
        "shipped: the weights that come with SlopeWatch, of the network chosen. none: from nothing, which needs many "
        "more files and steps. Or a .safetensors file.",
    )
    dimension: str = _parameter(
        "slopewatch_class",
        "Dimension with the labels",
        "Name of the clouds' dimension that holds the classes, such as slopewatch_class, truth_class or "
        "Classification. Has no effect where polygons give the labels.",
    )
    classes: str = _parameter(
        "",
        "Classes of the values",
        "What the values mean, such as 2:background,20:uplift,21:subsidence,*:unknown, where * is every other value "
        "and unknown is left out of training. Empty: 0 background, 1 uplift, 2 subsidence, 255 unknown.",
    )
    class_field: str = _parameter(
        "class",
        "Field with the class",
        "Field of the polygons that holds their class: background, uplift, subsidence, unknown, or a value that the "
        "classes explain.",
    )
    outside: str = _parameter(
        "background",
        "Outside of the polygons",
        "What points in no polygon are. unknown: they are left out of training, for clouds that were labelled in part.",
        choices=("background", "unknown"),
    )
    steps: int = _parameter(
        600,
        "Steps",
        "Steps of each training; there is one for every fold and one on all files. More fit better and take longer.",
        bounds=(1, 1_000_000),
    )
    minutes: float | str = _parameter(
        AUTO,
        "Time for everything",
        "Chooses the steps so that everything takes about this long on this machine. auto: the steps as given.",
        kind=float,
        unit="minutes",
        bounds=(0.01, 100_000.0),
    )
    folds: int = _parameter(
        5,
        "Folds",
        "The files are split into this many parts, each scored by a model that was not trained on it. With fewer files "
        "each one is a part. More need more trainings.",
        bounds=(2, 100),
    )
    learning_rate: float | str = _parameter(
        AUTO,
        "Learning rate",
        "Largest step size. Larger adapts faster and forgets more. auto: from weights 0.0005 on relief and 0.002 on "
        "points, from nothing 0.004 and 0.01.",
        kind=float,
        bounds=(0.00001, 1.0),
        advanced=True,
    )
    batch: int | str = _parameter(
        AUTO,
        "Places in a step",
        "Patches of relief or windows of points. Larger is more stable and takes more memory and time. auto: 5 "
        "patches, 2 windows.",
        kind=int,
        bounds=(1, 256),
        advanced=True,
    )
    network: str = _parameter(
        AUTO,
        "Network",
        "auto: that of the weights given, relief where none are. relief: the network on relief, which screening uses "
        "by default; more hazards are put into the background at every step. standard: the network on points. smoke: "
        "a tiny one on points that learns within a minute, for trials from nothing.",
        # QGIS stores the place of a choice: new ones go to the end.
        choices=("standard", "smoke", "relief", AUTO),
    )
    seed: int = _parameter(
        0,
        "Seed",
        "The same seed gives the same folds and, on one machine's processor, the same weights.",
        bounds=(0, 2**31 - 1),
        advanced=True,
    )
    device: str = _parameter(
        "cpu",
        "Device",
        "What the training runs on. auto: a graphics card where there is one.",
        choices=("cpu", "gpu", "auto"),
        advanced=True,
    )
    threads: int | str = _parameter(
        AUTO, "Threads", "Processor cores to use. auto: all of them.", kind=int, bounds=(1, 1024), advanced=True
    )
