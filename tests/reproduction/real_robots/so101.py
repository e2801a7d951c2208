"""SO-101, a desktop arm of hobby servos: a log without torque."""

from __future__ import annotations

import re
from pathlib import Path

from excite.diagnosis.diagnose import diagnose
from tests.reproduction.real_robots.entry import Bar, Entry
from tests.reproduction.so101 import KP, so101_log

# Mean error by hand on the joints that carry weight [rad], and between command and motion in steps not used [s].
_SAG, _DELAY = (0.035, 0.041), (0.02, 0.04)


def entries(data: Path, folder: Path) -> list[Entry]:
    """Eight motions, five of them used."""
    d = diagnose(so101_log(data, folder))
    said = [text for text in d.warnings if re.search("under its weight|dead band|torques act", text)]
    sags = {
        name: float(mm) for text in said for name, mm in re.findall(r"(\w+) ([+-]\d+) mrad \(weight", text)
    }
    late = [float(ms) for text in said for ms in re.findall(r"torques act ([\d.]+) ms after", text)]
    weighty = [sags.get(name, float("nan")) for name in ("Pitch", "Elbow")]
    near = all(0.9 * _SAG[0] <= 1e-3 * value <= 1.1 * _SAG[1] for value in weighty)
    return [
        Entry(
            title="SO-101, commands and positions only",
            source="Recordings published as sage (isaac-sim2real); model SO-ARM100 (TheRobotStudio).",
            trials="Four motions were fitted, a sum of sines judges.",
            baseline=(
                f"the public model as drawn; gain {KP:.1f} N·m/rad from the servo's bench figures; friction fitted."
            ),
            known="mean error 35 to 41 mrad on the joints that carry weight, at most 10 mrad elsewhere, by hand.",
            diagnosis=d,
            bars=(
                Bar(
                    "sag of Pitch and Elbow as by hand, within a tenth",
                    ", ".join(f"{value:.0f} mrad" for value in weighty),
                    near,
                ),
                Bar(
                    "late by one to two samples of 20 ms",
                    ", ".join(f"{value:.0f} ms" for value in late) or "no delay",
                    any(_DELAY[0] <= 1e-3 * value <= _DELAY[1] for value in late),
                ),
                Bar(
                    "play named",
                    ", ".join(f"{e.effect} at {e.location}" for e in d.effects)
                    or f"{d.verdict}: nothing named",
                    any(e.effect == "backlash" for e in d.effects),
                    "dry friction holds Pitch and Elbow anywhere within 32 and 35 mrad of their commands, and without "
                    "torques play is what is left of that dead band",
                ),
            ),
            remark=" ".join(f"{text[0].upper()}{text[1:]}." for text in said),
        )
    ]
