"""One slope of a batch, in a process of its own or in that of the batch: what it says, how it ends, its folder."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.file_lock import locked
from slopewatch.tests.builders.batch_program import PROGRAM, job, starts
from slopewatch.tests.builders.limits import PATIENCE_S
from slopewatch.workflows.batch.executors import InPlace
from slopewatch.workflows.batch.jobs import KILLED, MEMORY, Job, Outcome
from slopewatch.workflows.batch.results import result_of
from slopewatch.workflows.batch.slope_process import Events, run_job, work_on

GB = 1_000_000_000


def test_a_job_travels_as_json_and_is_not_done_twice(tmp_path: Path) -> None:
    made = job(tmp_path, "a", "done")
    travelled = json.loads(json.dumps(made.as_json()))
    assert Job.from_json(travelled) == made
    for _ in range(2):
        assert Outcome.from_json(run_job(travelled, PROGRAM)).done
    assert starts(made) == 1, "another worker had done it"
    (Path(made.folder) / "table.csv").unlink()
    assert result_of(made) is None, "a promised file is missing"
    assert run_job(travelled, PROGRAM)["sentence"] == ""
    assert starts(made) == 2


@pytest.mark.parametrize("change", ["task", "software", "command", "damaged", "empty", "outputs", "deep"])
def test_results_of_another_task_count_for_nothing(change: str, tmp_path: Path) -> None:
    made = job(tmp_path, "a", "done")
    assert work_on(made, PROGRAM).done
    path = Path(made.folder) / "run.json"
    record = json.loads(path.read_text())
    if change == "damaged":
        path.write_bytes(path.read_bytes()[:-5])
    elif change == "deep":
        path.write_text("[" * 100_000)
    elif change == "empty":
        (path.parent / "table.csv").write_bytes(b"")
    elif change == "outputs":
        path.write_text(json.dumps(record | {"outputs": {"table": "ta\0ble.csv"}}))
    else:
        path.write_text(json.dumps(record | {change: "another"}))
    assert result_of(made) is None


def test_what_a_child_says_is_heard_at_once(tmp_path: Path) -> None:
    heard = []
    outcome = work_on(job(tmp_path, "a", "done"), PROGRAM, lambda *words: heard.append(words))
    assert heard == [("a", 50.0, "half")]
    assert outcome.warnings == ("odd",)


@pytest.mark.parametrize(
    ("raised", "again", "words"),
    [
        (InputError("No cloud."), "", "No cloud."),
        (MemoryError(), MEMORY, "Memory ran out"),
        (ZeroDivisionError("x"), "", "Internal failure: ZeroDivisionError: x"),
    ],
)
def test_a_slope_that_fails_in_the_own_process_stops_no_other(
    raised: Exception, again: str, words: str, tmp_path: Path
) -> None:
    seen: list[str] = []

    def work(made: Job, events: Events) -> None:
        seen.append(os.environ["SLOPEWATCH_TASK"])
        raise raised

    executor = InPlace(work)
    executor.submit(job(tmp_path, "a", ""), GB)
    ended = executor.next(0.0)
    assert ended is not None
    assert ended[1].sentence.startswith(words)
    assert ended[1].again == again
    assert seen == ["task of a"]
    assert "SLOPEWATCH_TASK" not in os.environ


@pytest.mark.parametrize("line", [b"[]", b"\xff", b'{"event": 1}', b'{"event": "progress"}', b"null", b"[" * 99_999])
def test_lines_that_are_none_of_the_protocol_are_passed_over(line: bytes) -> None:
    events = Events("a", None)
    events.take(line)
    assert (events.error, events.warnings) == ("", [])


def test_what_a_killed_run_left_behind_is_removed_and_two_do_not_share_a_folder(tmp_path: Path) -> None:
    made = job(tmp_path, "a", "done")
    left = Path(made.folder) / ".slopewatch-part-x"
    left.mkdir(parents=True)
    (left / "half.tif").write_bytes(b"x")
    with locked(Path(made.folder) / ".lock", "Taken."):
        outcome = work_on(made, PROGRAM)
    assert (starts(made), outcome.again) == (0, KILLED)
    assert "Another process is at work in" in outcome.sentence
    assert left.exists(), "the other process may need it"
    assert work_on(made, PROGRAM).done
    assert not left.exists()


def test_a_lock_ends_with_its_process(tmp_path: Path) -> None:
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom slopewatch.engine.core.file_lock import locked\n"
        "with locked(Path(sys.argv[1]), ''):\n    print('held', flush=True)\n    time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code, tmp_path / "lock"], stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(InputError, match="taken"), locked(tmp_path / "lock", "It is taken."):
            pass
        holder.kill()
        holder.wait(PATIENCE_S)
    with locked(tmp_path / "lock", "It is taken."):
        pass
