"""UR10e: what its friction does under load, and a tool load that the model lacks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from excite.diagnosis.answer.candidate import Candidate
from excite.diagnosis.diagnose import diagnose
from tests.reproduction.real_robots.entry import FRICTION, RIGID, Bar, Entry, with_modelled
from tests.reproduction.real_robots.pictures import LOAD
from tests.reproduction.recordings import UR10E_GAINS, ur10e_log
from tests.reproduction.ur10e_load import MASS, bare_arm, loaded_log, weighed_gains

SOURCE = "Mamedov, Mikhel: Practical aspects of model-based collision detection. Frontiers in Robotics and AI 2020."
# What plain least squares by hand makes of the load with the published constants [kg].
_TOO_HEAVY = 3.08
_TIMING = {"time_delay", "actuator_lag"}


def entries(data: Path, folder: Path) -> list[Entry]:
    """Without the load, and with it: published torque constants and weighed ones."""
    weighed = weighed_gains(data, folder / "weighed")
    return [
        _bare(data, folder / "bare"),
        _loaded(data, folder / "published", UR10E_GAINS, "published torque constants", _TOO_HEAVY),
        _loaded(data, folder / "own", weighed, "torque constants from the run's first half", MASS),
    ]


def _bare(data: Path, folder: Path) -> Entry:
    log = with_modelled(ur10e_log(data, folder), (*RIGID, *FRICTION, "armature", "torque_bias"))
    d = diagnose(log)
    lift, elbow = (
        next(c for c in d.candidates if (c.effect, c.location) == ("load_dependent_friction", joint))
        for joint in ("shoulder_lift_joint", "elbow_joint")
    )
    timing = max((c.evidence for c in d.candidates if c.effect in _TIMING), default=0.0)
    gaps = (d.gap.per_channel[joint] for joint in ("shoulder_lift_joint", "elbow_joint"))
    less, less_at_elbow = (100.0 * (1.0 - gap.after / gap.before) for gap in gaps)
    named = {(e.effect, e.location) for e in d.effects}
    return Entry(
        title="UR10e, no load",
        source=SOURCE,
        trials="The runs of 20, 30, 40 and 50 s were fitted, the run of 14 harmonics judges.",
        baseline="rigid bodies, viscous and Coulomb friction, rotor inertia and an offset of every joint.",
        known="nothing was published of its friction but Coulomb and viscous levels; torque constants are uncertain.",
        diagnosis=d,
        bars=(
            Bar(
                "load-dependent friction of the shoulder lift is the first effect",
                f"{d.effect} at {d.location}",
                (d.effect, d.location) == ("load_dependent_friction", "shoulder_lift_joint"),
            ),
            Bar(
                "that of the elbow, of like size, is the second",
                f"{elbow.parameters['coefficient'].value:.3f} beside {lift.parameters['coefficient'].value:.3f}",
                ("load_dependent_friction", "elbow_joint") in named,
            ),
            Bar(
                "a late torque channel does not explain it as well",
                f"{timing:.0f} nats for the likeliest delay or lag, {lift.evidence:.0f} for friction",
                timing < 0.1 * lift.evidence,
            ),
        ),
        remark=(
            f"On the run that was left out the shoulder lift's gap shrinks by {less:.0f} %, the elbow's by "
            f"{less_at_elbow:.0f} %. Other joints stand above the white noise too; no trial was repeated to tell their "
            "rest from noise."
        ),
    )


def _inside(first: Candidate | None, mass: float) -> Bar:
    """Whether the mass as weighed lies in the 90 % interval of the diagnosis."""
    std = first.parameters["mass"].std if first is not None and "mass" in first.parameters else None
    what = f"{MASS} kg inside the 90 % interval"
    if std is None:
        return Bar(what, "no interval", met=False)
    half = 1.645 * std
    return Bar(what, f"{mass:.3f} ± {half:.3f} kg", abs(mass - MASS) <= half)


def _loaded(data: Path, folder: Path, gains: Mapping[str, float], which: str, expected: float) -> Entry:
    log = loaded_log(data, folder, gains)
    d = diagnose(log, bare_arm(data, folder, gains))
    first = d.effects[0] if d.effects else None
    mass = (
        first.parameters["mass"].value if first is not None and "mass" in first.parameters else float("nan")
    )
    off = 100.0 * (mass / expected - 1.0)
    rival = max(
        (c.evidence for c in d.candidates if c.effect == "payload" and c.location != d.location), default=0.0
    )
    return Entry(
        title=f"UR10e, tool load, {which}",
        source=SOURCE,
        trials="50 to 80 % of the loaded run were fitted, its last fifth judges.",
        baseline=(
            "inertial parameters as identified from four runs without load, friction, rotor inertia and offsets fitted."
        ),
        known=f"{MASS} kg at the tool; by hand the published torque constants make it {_TOO_HEAVY} kg.",
        diagnosis=d,
        bars=(
            Bar("a payload", str(d.effect), d.verdict == "effect" and d.effect == "payload"),
            Bar(
                "on the last link",
                str(d.location),
                d.location == "wrist_3_link" and len(d.tied_locations) == 1,
            ),
            Bar(f"{expected} kg within 3 %", f"{mass:.3f} kg, {off:+.1f} %", abs(off) <= 3.0),
            *([_inside(first, mass)] if expected == MASS else []),
        ),
        picture=LOAD if expected == MASS else None,
        remark=(
            f"A payload on another link reaches {rival:.0f} nats at most. Mass and torque constants scale together: "
            "what the constants are off, the mass is."
        ),
    )
