"""Progress that is passed on: its messages, warnings and percent are those of the progress behind it."""

from __future__ import annotations

from slopewatch.engine.core.progress import Progress, Renamed


class Kept(Progress):
    def __init__(self) -> None:
        super().__init__()
        self.shown: list[tuple[str, str]] = []
        self.percents: list[float] = []

    def emit(self, percent: float, message: str) -> None:
        self.percents.append(round(percent, 6))

    def show(self, level: str, message: str) -> None:
        self.shown.append((level, message))


def test_a_copy_is_called_by_the_name_of_what_was_given():
    kept = Kept()
    with kept.stage(0.5, 1.0):
        renamed = Renamed(kept, "'/tmp/part/a.laz'", "'a.laz'")
        with renamed.stage(0.0, 0.5):
            renamed.update(0.5)
        renamed.warning("'/tmp/part/a.laz' has holes.")
        renamed.warning("'/tmp/part/a.laz' has holes.")
        renamed.info("Read '/tmp/part/a.laz'.")
    assert kept.percents == [50.0, 50.0, 62.5, 75.0, 100.0]
    assert kept.warnings == renamed.warnings == ["'a.laz' has holes."]
    assert kept.shown == [("warning", "'a.laz' has holes."), ("info", "Read 'a.laz'.")]
