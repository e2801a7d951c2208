"""The doctor on logs that were made ill, and on healthy ones; what a diagnosis makes of the ill ones."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from excite.diagnosis.diagnose import diagnose
from excite.doctor.examine import doctor
from excite.errors import ExciteError
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from tests.benchmarks.table import Row
from tests.doctor.illnesses import ILLNESSES

GAP = (
    Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data")).parent
    / "gap"
)
# One log of each of four arms; thresholds were chosen on others.
_ILL = ("case_001", "case_003", "case_011", "case_013")
# Of the ill logs that are diagnosed, every so many-th: each takes some ten seconds.
_DIAGNOSED = 4


def rows() -> list[Row]:
    """Illnesses found by name, false alarms, and illnesses that a diagnosis names as an effect."""
    if not GAP.is_dir():
        return [Row("logs made ill", "", f"no practice cases in {GAP}", None)]
    with tempfile.TemporaryDirectory() as name:
        ill = list(_ill_logs(Path(name)))
        found, wrong = 0, []
        for label, kind, folder in ill:
            kinds = _kinds(folder)
            found += kind in kinds
            if kind not in kinds:
                wrong.append(f"{label}: {', '.join(sorted(kinds)) or 'nothing'}")
        named = [label for label, _, folder in ill[::_DIAGNOSED] if _named(folder)]
        counted = len(ill[::_DIAGNOSED])
    healthy = sorted([*(GAP / "arm").glob("case_*"), *(GAP / "many").glob("case_*")])
    alarms = [f"{path.name}: {', '.join(kinds)}" for path in healthy if (kinds := _alarms(path))]
    missed = f" (missed: {'; '.join(wrong)})" if wrong else ""
    false = f" ({'; '.join(alarms)})" if alarms else ""
    share = f"{found} of {len(ill)}{missed}"
    return [
        Row.holds("ill logs, found with the right name", "≥ 95 %", share, found >= 0.95 * len(ill)),
        Row.holds("healthy logs with an alarm", "0", f"{len(alarms)} of {len(healthy)}{false}", not alarms),
        Row.holds(
            "ill logs whose illness a diagnosis names as an effect",
            "0",
            f"{len(named)} of {counted}{' (' + '; '.join(named) + ')' if named else ''}",
            not named,
        ),
    ]


def _ill_logs(folder: Path) -> Iterator[tuple[str, str, Path]]:
    """Label, kind of the finding wanted, and folder of every ill log."""
    for case in _ILL:
        log = load_log(GAP / "arm" / case)
        for k, (name, illness) in enumerate(ILLNESSES.items()):
            for strength in (0, 1):
                rng = np.random.default_rng([k, strength, int(case[-3:])])
                sick: Log = illness.change(log, rng, strength)
                label = f"{case} {name} {('weak', 'strong')[strength]}"
                yield label, illness.kind, save_log(sick, folder / label.replace(" ", "_"))


def _kinds(folder: Path) -> set[str]:
    try:
        return {item.kind for item in doctor(folder).findings}
    except ExciteError as error:
        return {item.kind for item in getattr(error, "findings", ())} or {type(error).__name__}


def _alarms(folder: Path) -> list[str]:
    return [item.kind for item in doctor(folder).findings if item.severity in {"fatal", "spoils"}]


def _named(folder: Path) -> bool:
    """Whether a diagnosis names an effect that it does not name in the log before it was made ill."""
    log = load_log(folder)
    try:
        ill = diagnose(log, nominal_robot(log))
    except ExciteError:
        return False
    case = next(part for part in _ILL if folder.name.startswith(part))
    known = {(item.effect, item.location) for item in diagnose(GAP / "arm" / case).effects}
    return any((item.effect, item.location) not in known for item in ill.effects)


if __name__ == "__main__":
    from tests.benchmarks.table import markdown

    print(markdown(rows()))
