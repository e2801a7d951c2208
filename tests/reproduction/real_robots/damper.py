"""A friction damper with play, at three tensions of its band."""

from __future__ import annotations

from pathlib import Path

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from tests.reproduction.brfd import TWO_AMPLITUDES, at_tension, brfd_log
from tests.reproduction.real_robots.entry import Bar, Entry, names
from tests.reproduction.real_robots.pictures import DAMPER

# The force is about zero from 2 to 4.5 mm after every reversal, read off the recordings [m].
PLAY = 2.5e-3
_TRIALS = {
    20: "The first 4.5 s were fitted, 4.5 to 7.5 s judge; then it stands.",
    30: "Half an inch and half of the run at one and a half were fitted, the rest of that run judges.",
    80: "The first 4.5 s were fitted, 4.5 to 7.5 s judge; then it stands.",
}
# Read off the recordings, reversal by reversal: where the force is below a tenth of its level.
_WIDTH = {
    30: "at this tension the force is below a tenth of its level from 1.5 to 5.3 mm after a reversal, 3.8 mm; at 20 lb "
    "over 1.6 mm, at 80 lb over 3.4 mm"
}
_LEFT = {
    20: "what is left is the floor: of a slack band the play differs by 0.8 mm from one reversal to the next, which no "
    "law of position and velocity follows",
    30: "the level is 10.4 kN where the stroke is half an inch and 11.7 kN where it is one and a half: friction of the "
    "band grows with the stroke, and dry friction does not",
}


def entries(data: Path, folder: Path) -> list[Entry]:
    """Tensions from low to high."""
    made: list[Entry] = []
    levels: list[float] = []
    for tension, trials in _TRIALS.items():
        parts = TWO_AMPLITUDES if tension == 30 else at_tension(tension)
        d = diagnose(brfd_log(data, folder / str(tension), parts))
        dry = next((item for item in d.effects if item.effect == "coulomb_friction"), None)
        levels.append(float("nan") if dry is None else 1e-3 * dry.parameters["level"].value)
        bars = [
            Bar(
                "dry friction and play, nothing else",
                ", ".join(names(d)),
                set(names(d)) == {"coulomb_friction", "backlash"},
            ),
            Bar(
                f"the play's width, {1000 * PLAY:.1f} mm by hand, within 40 %",
                _width(d),
                "backlash" in names(d) and abs(_play(d) / PLAY - 1.0) < 0.4,
                _WIDTH.get(tension, ""),
            ),
            Bar(
                "at most 12 % left", f"{100 * d.gap.after:.1f} %", d.gap.after <= 0.12, _LEFT.get(tension, "")
            ),
        ]
        if tension == max(_TRIALS):
            text = ", ".join(f"{level:.1f} kN" for level in levels)
            bars.append(Bar("friction rises with tension: 20, 30, 80 lb", text, levels == sorted(levels)))
        made.append(
            Entry(
                title=f"Friction damper with play, band at {tension} lb",
                source="Coble, Huggins, Cao, Ricles, Downey: Data set of a friction damper with backlash, 2022.",
                trials=trials,
                baseline="none: the device's force is all there is.",
                known="dry friction that rises with the band's tension, and play, by construction.",
                diagnosis=d,
                bars=tuple(bars),
                picture=DAMPER if tension == 30 else None,
            )
        )
    return made


def _play(d: Diagnosis) -> float:
    return next(item.parameters["width"].value for item in d.effects if item.effect == "backlash")


def _width(d: Diagnosis) -> str:
    """How wide the play is, and over which way friction builds up beyond it."""
    found = {item.effect: item.parameters for item in d.effects}
    if "backlash" not in found:
        return "no play"
    width, way = found["backlash"]["width"].value, found["coulomb_friction"]["breakaway"].value
    return f"{1000 * width:.1f} mm, then friction builds up over {1000 * way:.1f} mm"
