"""Diagnosis scored blind: cases drawn by the simulation's own injectors, with a seed used for nothing else."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

from benchmarks.blind.make import load_answers, make_cases
from benchmarks.blind.score import BlindScore, score_diagnoses
from excite.diagnosis.diagnose import diagnose
from tests.benchmarks.table import Row

SEED, CASES = 818283, 60
# Groups of effects whose main parameter is to be as close as this, relative, in the median.
CLOSE = (
    (3.0, ("viscous_friction", "coulomb_friction", "load_dependent_friction")),
    (3.0, ("torque_bias",)),
    (3.0, ("torque_gain",)),
    (3.0, ("payload",)),
    (3.0, ("base_tilt",)),
    (12.0, ("backlash",)),
    (12.0, ("time_delay", "actuator_lag")),
    (12.0, ("stribeck",)),
    (12.0, ("friction_drift",)),
)


def scored(seed: int = SEED, cases: int = CASES) -> BlindScore:
    """Make the cases, diagnose all of them, and only then look at the answers."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "cases"
        make_cases(folder, seed=seed, cases=cases)
        documents, seconds = {}, {}
        for case in sorted(folder.glob("case_*")):
            started = time.process_time()
            documents[case.name] = diagnose(case).to_json()
            seconds[case.name] = time.process_time() - started
        return score_diagnoses(load_answers(folder), documents, seconds)


def percentages(result: BlindScore) -> Callable[[str], float]:
    """The score's shares by name, in percent; 0 where there was no such case."""
    figures = result.figures()
    return lambda name: 100.0 * float(figures[name] or 0.0)


def rows() -> list[Row]:
    """Figures of the battery."""
    result = scored()
    figures, percent = result.figures(), percentages(result)
    title = f"blind arms ({CASES} cases)"
    return [
        Row.at_least(f"{title}: one effect, right name", percent("single_named"), 95.0, "%"),
        Row.at_least(f"{title}: one effect, right place", percent("single_placed"), 97.0, "%"),
        Row.at_least(f"{title}: weak over a background, named", percent("weak_named"), 80.0, "%"),
        Row.at_least(f"{title}: two effects, found", percent("double_found"), 90.0, "%"),
        Row.at_least(f"{title}: 'none' kept", percent("none_kept"), 98.0, "%"),
        Row.at_least(
            f"{title}: 'none' of faulty records kept", percent("none_of_faulty_records_kept"), 95.0, "%"
        ),
        Row.at_least(f"{title}: 'unknown' recognised", percent("unknown_recognised"), 90.0, "%"),
        Row.at_most(f"{title}: firm wrong names", percent("firm_wrong"), 2.0, "%"),
        Row.at_least(f"{title}: share of the gap closed, median", percent("median_share_closed"), 97.0, "%"),
        Row.at_least(
            f"{title}: share of the gap closed, worst tenth", percent("worst_tenth_share_closed"), 80.0, "%"
        ),
        Row(f"{title}: Brier score of stated probabilities", "", f"{figures['brier'] or 0.0:.3f}", None),
        *_parameters(title, result),
        Row.at_most(
            f"{title}: processor time of a case, median", float(figures["seconds_median"] or 0), 10, "s"
        ),
    ]


def _parameters(title: str, result: BlindScore) -> list[Row]:
    """Median errors of main parameters, by group of effects, of those that were found."""
    made = []
    for limit, names in CLOSE:
        errors = [e for case in result.cases for name, e in case.parameter_errors if name in names]
        if errors:
            what = f"{title}: error of {', '.join(names).replace('_', ' ')}, median of {len(errors)}"
            made.append(Row.at_most(what, 100.0 * median(errors), limit, "%"))
    return made
