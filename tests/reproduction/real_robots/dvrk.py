"""da Vinci Research Kit: 105 g on a surgical arm, against the run without them."""

from __future__ import annotations

from pathlib import Path

from excite.diagnosis.diagnose import diagnose
from tests.reproduction.dvrk import MASS, Place, by_hand, dvrk_log
from tests.reproduction.real_robots.entry import Bar, Entry
from tests.reproduction.real_robots.pictures import WEIGHT

SOURCE = "Wang, Gondokaryono, Munawar, Fischer: Dynamic model identification for the da Vinci Research Kit. RA-L 2019."
_WHERE = {"insertion": "at the insertion axis", "parallel": "on the parallelogram"}


# Twice what halves of the runs differ by, by hand [kg·m, N·m].
_APART, _CONSTANT_APART = 0.002, 0.012
_RUNS: tuple[tuple[Place, Place | None], ...] = (
    ("insertion", None),
    ("parallel", None),
    ("insertion", "parallel"),
)


def entries(data: Path, folder: Path) -> list[Entry]:
    """The weight at either place against the run without it, and at one place against the other."""
    return [_weight(data, folder, *runs) for runs in _RUNS]


def _weight(data: Path, folder: Path, place: Place, against: Place | None) -> Entry:
    d = diagnose(dvrk_log(data, folder, place, against=against))
    body = next((e for e in d.effects if "first_moment" in e.parameters), None)
    moment = float("nan") if body is None else body.parameters["first_moment"].value
    constants = {e.location: e.parameters["bias"].value for e in d.effects if e.effect == "torque_bias"}
    constant = constants.get("pitch", 0.0)
    least_squares, constant_by_hand = by_hand(data, place, against)
    closed = [
        f"{name} {gap.before:.2f} → {gap.after:.2f} N·m"
        for name, gap in d.gap.per_channel.items()
        if name != "insertion"
    ]
    other = "" if against is None else f" against {_WHERE[against].removeprefix('at ').removeprefix('on ')}"
    bare = "the run without weight" if against is None else f"the run with the weight {_WHERE[against]}"
    return Entry(
        title=f"dVRK patient-side arm, 105 g {_WHERE[place]}{other}",
        source=SOURCE,
        trials="The first half of 30 s was fitted, the second judges.",
        baseline=f"{bare}: its torques at the same instants are taken off; links weigh nothing.",
        known=f"{1000 * MASS:.0f} g were added {_WHERE[place]}; where exactly is not published as numbers. Both runs "
        "with the weight differ from the one without by a constant torque at the pitch axis, and not from each other: "
        "the weight is not what makes it.",
        diagnosis=d,
        bars=(
            Bar(
                "a payload on what turns with the pitch axis",
                "none" if body is None else body.location,
                d.verdict == "effect"
                and body is not None
                and body.location in {"pitch_link", "insertion_link"},
            ),
            Bar(
                "the payload alone",
                ", ".join(f"{e.effect} at {e.location}" for e in d.effects) or "nothing named",
                [e.effect for e in d.effects] == ["payload"],
                "the runs differ by springs, cables and friction too, two of the three by a constant torque",
            ),
            Bar(
                f"its first moment as by least squares, {least_squares:.4f} kg·m, within {1000 * _APART:.0f} g·m",
                f"{moment:.4f} kg·m",
                abs(moment - least_squares) < _APART,
            ),
            Bar(
                f"constant at pitch as by least squares, {constant_by_hand:.3f} N·m, within {_CONSTANT_APART} N·m",
                f"{constant:.3f} N·m",
                abs(constant - constant_by_hand) < _CONSTANT_APART,
            ),
        ),
        picture=WEIGHT if (place, against) == ("insertion", None) else None,
        remark=(
            f"{', '.join(closed)}. Both axes pass through the remote centre, and the insertion axis carries nothing "
            f"of the weight, so the mass itself is not felt: only its first moment, {moment:.4f} kg·m. Further effects "
            "are differences of springs, cables and friction between the two runs. No roll-outs: a model without "
            "masses has none."
        ),
    )
