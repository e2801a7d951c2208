"""da Vinci Research Kit: 105 g on a surgical arm, against the run without them."""

from __future__ import annotations

from pathlib import Path

from excite.diagnosis.diagnose import diagnose
from tests.reproduction.dvrk import MASS, Place, dvrk_log
from tests.reproduction.real_robots.entry import Bar, Entry
from tests.reproduction.real_robots.pictures import WEIGHT

SOURCE = "Wang, Gondokaryono, Munawar, Fischer: Dynamic model identification for the da Vinci Research Kit. RA-L 2019."
_WHERE = {"insertion": "at the insertion axis", "parallel": "on the parallelogram"}


def entries(data: Path, folder: Path) -> list[Entry]:
    """The weight at either place."""
    return [_weight(data, folder, place) for place in ("insertion", "parallel")]


def _weight(data: Path, folder: Path, place: Place) -> Entry:
    d = diagnose(dvrk_log(data, folder, place))
    body = next((e for e in d.effects if "first_moment" in e.parameters), None)
    moment = float("nan") if body is None else body.parameters["first_moment"].value
    arm = 100.0 * moment / MASS
    closed = [
        f"{name} {gap.before:.2f} → {gap.after:.2f} N·m"
        for name, gap in d.gap.per_channel.items()
        if name != "insertion"
    ]
    return Entry(
        title=f"dVRK patient-side arm, 105 g {_WHERE[place]}",
        source=SOURCE,
        trials="The first half of 30 s was fitted, the second judges.",
        baseline="the run without weight: its torques at the same instants are taken off; links weigh nothing.",
        known=f"{1000 * MASS:.0f} g were added {_WHERE[place]}; where exactly is not published as numbers.",
        diagnosis=d,
        bars=(
            Bar("a payload", str(d.effect), d.verdict == "effect" and d.effect == "payload"),
            Bar(
                "on what turns with the pitch axis",
                str(d.location),
                d.location in {"pitch_link", "insertion_link"},
            ),
        ),
        picture=WEIGHT if place == "insertion" else None,
        remark=(
            f"{', '.join(closed)}. Both axes pass through the remote centre, and the insertion axis carries nothing "
            f"of the weight, so the mass itself is not felt: only its first moment, {moment:.4f} kg·m, which "
            f"{1000 * MASS:.0f} g have {arm:.0f} cm from the remote centre. Further effects are differences of "
            "springs, cables and friction between the two runs. No roll-outs: a model without masses has none."
        ),
    )
