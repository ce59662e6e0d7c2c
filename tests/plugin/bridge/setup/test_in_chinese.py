"""The set-up in a QGIS whose language is Chinese: what it says when it works, and for each thing that goes wrong."""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import pytest
from qgis.core import QgsApplication, QgsProcessingContext, QgsProcessingException
from slopewatch.plugin.bridge import language
from slopewatch.plugin.bridge.setup import problems
from slopewatch.plugin.bridge.setup.pythons import none_found
from slopewatch.plugin.bridge.words import tr
from slopewatch.processing_algorithms.setupengine import SetupEngine
from slopewatch.tests.builders.algorithm_inputs import Inputs
from slopewatch.tests.builders.algorithm_runs import with_tiny_wheels
from slopewatch.tests.builders.qgis import Recorder

LEFT = re.compile(r"(?:\b[A-Za-z][a-z]+ ){2,}[a-z]+\b")
"""Three English words in a row."""
CHINESE = re.compile("[\u4e00-\u9fff]")
FOLDER, ROOM = PurePosixPath("/home/a b/data"), "1.5 GB (there are 0.2 GB)"
WRITTEN = (
    "No space left on device", "ProxyError", "Missing dependencies for SOCKS", "CERTIFICATE_VERIFY_FAILED",
    "DO NOT MATCH THE HASHES", "Name or service not known", "IncompleteRead", "Permission denied",
    "No matching distribution found for x", "ERROR: odd",
)  # fmt: skip
TASKS = (
    "Downloading numpy 2.4.6", "Downloading pip", "Installing pip", "Installing the engine's packages",
    "Installing the screening's packages", "Making an environment", "Checking the engine", "Checking PyTorch",
)  # fmt: skip


@pytest.fixture
def chinese(qgis_app: QgsApplication, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(language.QgsApplication, "locale", staticmethod(lambda: "zh_CN"))
    installed = language.install()
    yield
    language.remove(installed)


def english(sentences: list[str]) -> list[str]:
    """Those of the sentences that are not, or not wholly, in Chinese."""
    return [text for text in sentences if text and (LEFT.search(text) or not CHINESE.search(text))]


def test_each_sentence_of_what_goes_wrong_is_in_the_catalogue(chinese: None) -> None:
    said = [str(problems.of_output([line], "Downloading numpy 2.4.6", FOLDER, ROOM)) for line in WRITTEN]
    said += [str(problems.of_output(["ERROR: odd"], task, FOLDER, ROOM)) for task in TASKS]
    said += [str(problems.of_system(OSError(n, "x"), FOLDER, ROOM)) for n in (errno.ENOSPC, errno.EACCES, errno.EIO)]
    said += [str(none_found([])), str(none_found(["Python 3.9 at /usr/bin/python3 is too old"]))]
    said += [problems.CANCELLED]
    no_build = problems.of_output(["No matching distribution found for x"], "Downloading torch 2.1", FOLDER, ROOM)
    said.append(f"{no_build} All but training and the network on points works without it.")
    assert english(said) == said, "they arise in English"
    assert english([tr(sentence) for sentence in said]) == []


def run(feedback: Any, **parameters: Any) -> dict[str, Any]:
    algorithm = SetupEngine().create()
    found, done = algorithm.run(parameters, QgsProcessingContext(), feedback, catchExceptions=False)
    assert done
    return dict(found)


def test_a_set_up_says_everything_in_chinese(
    chinese: None, feedback: Recorder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SLOPEWATCH_PYTHON", raising=False)
    inputs = Inputs(tmp_path)
    with_tiny_wheels(inputs, tmp_path, monkeypatch)
    results = run(feedback, WHEELS=str(inputs.wheels))
    assert Path(results["ENGINE"]).is_file()
    run(feedback, WHEELS=str(inputs.wheels))
    said = [text for kind, text in feedback.lines if kind != "debug"]
    assert len(said) >= 8
    assert english(said) == []
    with pytest.raises(QgsProcessingException) as refused:
        run(feedback, WHEELS=str(tmp_path / "nowhere"), REPAIR=True)
    assert english([str(refused.value)]) == []
    with pytest.raises(QgsProcessingException) as refused:
        run(feedback, PYTHON="/bin/false", REPAIR=True)
    assert english([str(refused.value)]) == []
