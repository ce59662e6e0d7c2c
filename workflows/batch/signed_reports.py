"""Reports to sign of slopes whose results are there, where what they are to say has changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

from ...engine.core.input_files import read_input
from ...engine.core.json_shapes import parse_json
from ...engine.core.progress import Progress
from ...interface.input_files import RECORD
from ...interface.parameters import DetailParameters, ReportParameters
from ..report import report_step
from .jobs import Job
from .results import SlopeResult
from .settings import details_in


def renewed_reports(results: Sequence[SlopeResult], jobs: Mapping[str, Job], progress: Progress) -> list[SlopeResult]:
    """The results, with a new report where a PDF is wanted and there is none, or one with other details.

    Nothing else of a slope is computed again.

    Raises:
        InputError: the details do not fit a slope's surveys.
    """
    return [_renewed(result, details_in(jobs[result.slope].options), progress) for result in results]


def _renewed(result: SlopeResult, details: DetailParameters, progress: Progress) -> SlopeResult:
    known = dict(result.record.get("parameters", {}).get(DetailParameters.record_name) or {})
    if not details.pdf or ("report" not in result.outputs) or known == asdict(details):
        return result
    progress.info(f"Writing the report of {result.slope} again, for its details.")
    report_step(result.folder, ReportParameters(), details=details, profiles=None, progress=Progress())
    record = parse_json(read_input(result.folder / "run.json", RECORD))
    files = {str(name): result.folder / str(path) for name, path in record["outputs"].items()}
    return replace(result, record=record, outputs=files)
