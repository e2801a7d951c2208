"""Machines with one axis: two motors on a shaft, servos with a pendulum, one joint of an arm."""

from __future__ import annotations

import json
from pathlib import Path

from excite.diagnosis.diagnose import diagnose
from tests.reproduction.bam import LENGTH, PUBLISHED_LOAD_FRICTION, bam_log
from tests.reproduction.bam import MASS as PENDULUM_MASS
from tests.reproduction.franka_joint2 import PUBLISHED, franka_joint2_log
from tests.reproduction.hsm150 import BY_HAND, CATALOGUE_INERTIA, STEPS, by_direction, hsm150_log
from tests.reproduction.real_robots.entry import Bar, Entry, names, with_repeats
from tests.reproduction.sts3250 import FOLDER, published_error, sts3250_log

# Coefficients of this servo that the authors publish, M3 doubled for one torque of the two that it multiplies.
_UNDER_LOAD = (0.24, 0.29)


def entries(data: Path, folder: Path) -> list[Entry]:
    """One or more of each."""
    return [_hsm150(data, folder), _bam(data, folder), _sts3250(data, folder), _franka(data, folder)]


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
                "no single confident inertia: an interval that holds what each direction says, by hand too",
                f"{text}; together {1e4 * low:.1f} to {1e4 * high:.1f} (·10⁻⁴ kg·m²)",
                bool(low <= min(*own.values(), *BY_HAND) and max(*own.values(), *BY_HAND) <= high),
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
                "a Stribeck term alone does not help (M2 as M1)",
                "not among the likeliest" if not stribeck else f"{stribeck[0]:.0f} nats",
                not stribeck or stribeck[0] < 10.0,
            ),
            Bar(
                f"friction under load of {_UNDER_LOAD[0]} to {_UNDER_LOAD[1]} (M3 to M6)",
                f"{value:.2f}",
                _UNDER_LOAD[0] <= value <= _UNDER_LOAD[1],
                "by the weight's torque, of which a straight line by hand has 0.46 to 0.52; theirs is by the motor's",
            ),
        ),
        remark=(
            f"Its coefficient here is {value:.2f} by the weight's torque: a straight line by hand through what moves "
            "at 0.1 rad/s or more has 0.46 to 0.52. The authors' 0.24 to 0.29 are by the motor's torque, friction and "
            "all. "
            "The coefficient is the slope of the straight line that comes nearest to a power of the load; a wrong "
            "torque constant scales load and friction alike."
        ),
    )


def _sts3250(data: Path, folder: Path) -> Entry:
    d = diagnose(sts3250_log(data, folder))
    gap = next(iter(d.gap.per_channel.values()))
    published = json.loads((data / FOLDER / "published_m6.json").read_text())["load_friction_external"]
    first = d.effects[0].parameters if d.effects else {}
    size = first.get("coefficient")
    error = published_error(data)
    return Entry(
        title="Feetech STS3250 with a pendulum, commands and positions only",
        source="Duclusaud, Passault, Padois, Ly: Extended friction models for servo actuators. ICRA 2025.",
        trials="Two motions were fitted, a third judges; all three as the authors' files have them.",
        baseline="the pendulum, the servo's gain, viscous and Coulomb friction and rotor inertia fitted.",
        known=(
            f"the authors' model M6 has {published:.2f} of the weight's torque as friction, and leaves "
            f"{1e3 * error:.1f} mrad of the motion that judges; it was fitted to it as well."
        ),
        diagnosis=d,
        bars=(
            Bar(
                "load-dependent friction, nothing else",
                f"{d.verdict}: " + ", ".join(names(d)),
                d.verdict == "effect" and d.effect == "load_dependent_friction",
            ),
            Bar(
                f"{published:.2f} within two deviations",
                "none" if size is None or size.std is None else f"{size.value:.2f} ± {size.std:.2f}",
                size is not None and size.std is not None and abs(size.value - published) < 2.0 * size.std,
            ),
            Bar(
                "no more left than by the published model", f"{1e3 * gap.after:.1f} mrad", gap.after <= error
            ),
        ),
    )


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
            Bar(
                "friction and a bias named",
                f"{d.verdict}: " + (", ".join(names(d)) or "nothing named"),
                "torque_bias" in names(d)
                and any("friction" in name or name == "stribeck" for name in names(d)),
                "what fits the slow and the fast minute does not hold in the middle one",
            ),
            Bar(
                f"no more left than a Stribeck term leaves, {stribeck} N·m as published",
                f"{gap.after:.3f} N·m",
                gap.after <= stribeck,
                "nothing is named, so nothing is taken off",
            ),
        ),
        remark=(
            "Position explains most, as friction under load and errors of the recording's own model would, but what "
            "fits the slow and the fast minute does not hold in the middle one: nothing is named."
        ),
    )
