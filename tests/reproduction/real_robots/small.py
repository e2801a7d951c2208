"""Machines with one axis: two motors on a shaft, a servo with a pendulum, a friction damper, one joint of an arm."""

from __future__ import annotations

from pathlib import Path

from excite.diagnosis.diagnose import diagnose
from tests.reproduction.bam import LENGTH, PUBLISHED_LOAD_FRICTION, bam_log
from tests.reproduction.bam import MASS as PENDULUM_MASS
from tests.reproduction.brfd import TWO_AMPLITUDES, at_tension, brfd_log
from tests.reproduction.franka_joint2 import PUBLISHED, franka_joint2_log
from tests.reproduction.hsm150 import CATALOGUE_INERTIA, STEPS, by_direction, hsm150_log
from tests.reproduction.real_robots.entry import Bar, Entry, names, with_repeats
from tests.reproduction.real_robots.pictures import DAMPER


def entries(data: Path, folder: Path) -> list[Entry]:
    """One or more of each."""
    return [_hsm150(data, folder), _bam(data, folder), *_brfd(data, folder), _franka(data, folder)]


def _hsm150(data: Path, folder: Path) -> Entry:
    log = with_repeats(hsm150_log(data, folder), {f"idf_{step}_2": f"idf_{step}_1" for step in STEPS})
    d = diagnose(log)
    sessions = by_direction(log)
    k = next(
        i
        for i, label in enumerate(sessions.base.labels)
        if not label.startswith(("viscous", "coulomb", "offset"))
    )
    own = dict(zip(sessions.names, sessions.values[:, k], strict=True))
    low, high = sessions.pooled.next_interval[:, k]
    text = ", ".join(f"{name} {1e4 * value:.2f}" for name, value in own.items())
    return Entry(
        title="HSM150, two motors on a shaft",
        source="Recordings published as HSM150-data (malik-robert).",
        trials="Two steps either way were fitted; the same, run again, judge and give the noise floor.",
        baseline="the shaft's inertia, viscous and Coulomb friction, the same in both directions.",
        known=f"{1e4 * CATALOGUE_INERTIA:.1f}·10⁻⁴ kg·m² a motor by catalogue; friction differs by direction.",
        diagnosis=d,
        bars=(
            Bar(
                "friction by direction, or a constant torque: on one axis the same",
                f"{d.verdict}: {', '.join(names(d))}",
                d.verdict == "ambiguous" and {"coulomb_asymmetry", "torque_bias"} <= set(names(d)),
            ),
            Bar(
                "no single confident inertia: an interval that holds what each direction says",
                f"{text}; together {1e4 * low:.1f} to {1e4 * high:.1f} (·10⁻⁴ kg·m²)",
                bool(low <= min(own.values()) and max(own.values()) <= high),
            ),
        ),
        remark="Inertias are those of `excite identify` with a direction as a session.",
    )


def _bam(data: Path, folder: Path) -> Entry:
    d = diagnose(bam_log(data, folder))
    best = d.candidates[0]
    others = [c for c in d.candidates if c.effect != best.effect]
    value = best.parameters["coefficient"].value if best.effect == "load_dependent_friction" else float("nan")
    stribeck = [c.evidence for c in d.candidates if c.effect == "stribeck"]
    return Entry(
        title="Dynamixel XL330 with a pendulum",
        source="Duclusaud, Passault, Padois, Ly: Extended friction models for servo actuators. ICRA 2025.",
        trials="Nine driven runs: servo gains 100 and 800 were fitted, gain 200 judges.",
        baseline="pendulum, viscous and Coulomb friction, rotor inertia (the authors' M1); torque from the duty.",
        known=(
            f"{PENDULUM_MASS} kg on {LENGTH} m. The authors extend their models from M1 (Coulomb and viscous) over M2 "
            "(Stribeck), M3 and M4 (load), to M5 and M6 (load by its direction) and find that it pays. Parameters "
            f"of this servo: M3 has {PUBLISHED_LOAD_FRICTION} of motor's and weight's torque together, which is about "
            "twice that per torque; M4 has no Stribeck term left but the load's; M5 and M6 have 0.29 and 0.27 of the "
            "motor's torque."
        ),
        diagnosis=d,
        bars=(
            Bar(
                "load-dependent friction before every other effect (M3 over M2)",
                f"{best.effect}, {best.evidence:.0f} nats; next {others[0].effect}, {others[0].evidence:.0f}",
                best.effect == "load_dependent_friction"
                and best.evidence > 3.0 * max(c.evidence for c in others),
            ),
            Bar(
                "its coefficient lies between twice that of M3 and a third above those of M5 and M6",
                f"{value:.2f}",
                2.0 * PUBLISHED_LOAD_FRICTION <= value <= 1.35 * 0.29,
            ),
            Bar(
                "a Stribeck term alone does not help (M2 as M1)",
                "not among the likeliest" if not stribeck else f"{stribeck[0]:.0f} nats",
                not stribeck or stribeck[0] < 10.0,
            ),
            Bar("it does not explain all (M5, M6 over M3)", d.verdict, d.verdict == "unknown"),
        ),
        remark=(
            "Half of the gap is left with load-dependent friction in the model, so no verdict is given that it is the "
            "effect: the encoder's step of 1.5 mrad hides which way the servo creeps below about 0.1 rad/s, and "
            "friction by the load's direction is not in the library."
        ),
    )


def _brfd(data: Path, folder: Path) -> list[Entry]:
    source = "Coble, Huggins, Cao, Ricles, Downey: Data set of a friction damper with backlash, 2022."
    known = "dry friction that rises with the band's tension, and play, by construction."
    made = []
    for title, parts, trials in (
        (
            "Friction damper with play, band at 30 lb",
            TWO_AMPLITUDES,
            "Half an inch and half of the run at one and a half were fitted, the rest of that run judges.",
        ),
        *(
            (
                f"Friction damper with play, band at {pounds} lb",
                at_tension(pounds),
                "The first 4.5 s were fitted, 4.5 to 7.5 s judge; then it stands.",
            )
            for pounds in (20, 80)
        ),
    ):
        d = diagnose(brfd_log(data, folder / str(len(made)), parts))
        found = {item.effect: item for item in d.effects}
        dry = found.get("coulomb_friction")
        way = dry.parameters.get("breakaway") if dry is not None else None
        level = f"{dry.parameters['level'].value / 1000:.1f} kN" if dry is not None else "no level"
        path = f" that builds up over {1000 * way.value:.1f} mm" if way is not None else ""
        made.append(
            Entry(
                title=title,
                picture=None if made else DAMPER,
                source=source,
                trials=trials,
                baseline="none: the device's force is all there is.",
                known=known,
                diagnosis=d,
                bars=(
                    Bar("dry friction", ", ".join(names(d)), d.effect == "coulomb_friction"),
                    Bar(
                        "play",
                        f"friction of {level}{path}",
                        "backlash" in found,
                        "the library's backlash is a link's that flies freely between contacts; a damper moves no "
                        "mass, and its play shows as the way over which friction builds up after a reversal",
                    ),
                ),
            )
        )
    return made


def _franka(data: Path, folder: Path) -> Entry:
    d = diagnose(franka_joint2_log(data, folder))
    gap = d.gap.per_channel["joint2"]
    coulomb, stribeck = PUBLISHED["middle"]
    return Entry(
        title="Franka joint 2, friction torque at three speeds",
        source="Data set of the neural friction model NNFM (longshike).",
        trials="The slow and the fast minute were fitted, the middle one judges.",
        baseline="viscous and Coulomb friction; rigid bodies are in the recording's own model.",
        known=(
            f"on the middle recording viscous and Coulomb friction leave {coulomb} N·m as published, with a Stribeck "
            f"term {stribeck}: what depends on velocity alone explains little."
        ),
        diagnosis=d,
        bars=(
            Bar(
                "the gap of the baseline as published",
                f"{gap.before:.3f} N·m",
                abs(gap.before / coulomb - 1.0) < 0.1,
            ),
            Bar("no friction of the velocity explains it", d.verdict, d.verdict == "unknown"),
            Bar(
                "it follows position, not velocity",
                d.where[0].depends_on,
                d.where[0].depends_on == "position",
            ),
        ),
        remark=(
            "Position explains most, as friction under load and errors of the recording's own model would, but what "
            "fits the slow and the fast minute does not hold in the middle one: nothing is named."
        ),
    )
