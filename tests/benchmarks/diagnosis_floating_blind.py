"""Standing robots scored blind: cases drawn by the simulation's own injectors, with a seed used for nothing else."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.blind.documents import Answer
from benchmarks.blind.floating import floating_draft
from benchmarks.blind.make import build_floating_case
from benchmarks.blind.score import BlindScore, score_diagnoses
from excite.diagnosis.floating.answer import residual_of
from excite.diagnosis.floating.diagnose import Analysis, analyse_log, diagnosis_of
from excite.diagnosis.floating.record import prepare_record
from excite.diagnosis.floating.spectrum import in_band
from excite.diagnosis.floating.state import State
from excite.errors import NoSolutionError
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from tests.benchmarks.diagnosis_blind import percentages
from tests.benchmarks.table import Row

SEED, CASES = 515253, 20


def scored(seed: int = SEED, cases: int = CASES, first: int = 0) -> tuple[BlindScore, list[bool]]:
    """Make the cases, diagnose all of them, and only then look at the answers.

    Cases for which no safe motions are found are left out.

    Returns:
        The score; and for each diagnosis that states an interval of the share closed, whether the share of the
        noiseless gap that it really closes lies in it.
    """
    answers: dict[str, Answer] = {}
    documents, seconds, covered = {}, {}, []
    children = np.random.SeedSequence(seed).spawn(first + cases)
    with tempfile.TemporaryDirectory() as place:
        for number in range(first, first + cases):
            name, rng = f"case_{number:03d}", np.random.default_rng(children[number])
            try:
                case = build_floating_case(floating_draft(number, rng), rng)
            except NoSolutionError as error:
                sys.stderr.write(f"{name} left out: {error}\n")
                continue
            save_log(case.log, Path(place) / name)
            answers[name] = case.answer
            started = time.process_time()
            analysis = analyse_log(load_log(Path(place) / name))
            documents[name] = diagnosis_of(analysis).to_json()
            seconds[name] = time.process_time() - started
            interval = documents[name]["gap"]["share_closed_90"]
            if interval is not None:
                quiet = save_log(case.quiet, Path(place) / f"{name}-quiet")
                truly = truly_closed(analysis, load_log(quiet))
                covered.append(bool(interval[0] <= truly <= interval[1]))
            sys.stderr.write(f"{name} diagnosed in {seconds[name]:.0f} s\n")
    return score_diagnoses(answers, documents, seconds), covered


def truly_closed(analysis: Analysis, quiet: Log) -> float:
    """Share of the gap's power that a diagnosis' model closes in the same validation trials without noise."""
    record = prepare_record(quiet)
    problem = replace(analysis.problem, record=record, nominal=State.from_log(record))
    held_out = problem.record.validation_samples()
    measured = in_band(analysis.problem.record, analysis.problem.nominal.measured_forces)
    scale = measured[~held_out].std(axis=0)
    before, after = (
        float(((residual_of(problem, fitted)[held_out] / scale) ** 2).sum())
        for fitted in (analysis.found.baseline, analysis.named_fit)
    )
    return 1.0 - after / before


def rows() -> list[Row]:
    """Figures of the battery."""
    result, covered = scored()
    percent = percentages(result)
    title = f"blind standing robots ({CASES} cases)"
    return [
        Row.at_least(f"{title}: one effect, right name", percent("single_named"), 90.0, "%"),
        Row.at_least(f"{title}: one effect, right place", percent("single_placed"), 95.0, "%"),
        Row.at_least(f"{title}: two effects, found", percent("double_found"), 90.0, "%"),
        Row.at_least(f"{title}: 'none' kept", percent("none_kept"), 98.0, "%"),
        Row.at_least(f"{title}: 'unknown' recognised", percent("unknown_recognised"), 90.0, "%"),
        Row.at_most(f"{title}: firm wrong names", percent("firm_wrong"), 2.0, "%"),
        Row.at_least(f"{title}: gap closed, median", percent("median_share_closed"), 97.0, "%"),
        Row.at_least(f"{title}: gap closed, worst tenth", percent("worst_tenth_share_closed"), 80.0, "%"),
        Row.at_least(
            f"{title}: 90 % interval holds the share closed",
            100.0 * sum(covered) / max(1, len(covered)),
            85.0,
            "%",
        ),
    ]


if __name__ == "__main__":
    battery, holds = scored(*(int(number) for number in sys.argv[1:]))
    sys.stdout.write(battery.summary() + f"\nintervals that hold: {sum(holds)} of {len(holds)}\n")
    sys.stdout.write(json.dumps(battery.to_json()["confusion"]) + "\n")
