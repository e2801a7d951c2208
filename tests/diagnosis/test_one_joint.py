"""An axis alone: a sliding joint, a long trial to fit on and a short one to judge by."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.attribution import Scorer
from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.next_experiment.advice import propose_motion
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, LogHeader, Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.hypotheses import fitted

URDF = """<robot name="axis">
  <link name="frame"/>
  <link name="carriage">
    <inertial><mass value="100"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="slide" type="prismatic">
    <parent link="frame"/><child link="carriage"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="500" velocity="2"/>
  </joint>
</robot>
"""
RATE_HZ = 500
MASS, VISCOUS, COULOMB, OFFSET, NOISE = 95.0, 200.0, 20.0, -3.2, 1.0


Force = Callable[[np.ndarray], np.ndarray]


def pushed(
    name: str,
    role: str,
    seconds: float,
    phase: float,
    rng: np.random.Generator,
    size: float = 1.0,
    more: Force = np.zeros_like,
) -> Trial:
    """A trial whose force is that of mass, friction, a constant push, and more by position, with white noise."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    sizes, turns = (0.1, 0.04, 0.01), (0.4, 1.1, 2.7)
    waves = [
        (size * a, 2.0 * np.pi * f, phase * (k + 1))
        for k, (a, f) in enumerate(zip(sizes, turns, strict=True))
    ]
    q = sum(a * np.sin(w * t + p) for a, w, p in waves)
    v = sum(a * w * np.cos(w * t + p) for a, w, p in waves)
    acceleration = sum(-a * w**2 * np.sin(w * t + p) for a, w, p in waves)
    friction = VISCOUS * v + COULOMB * np.sign(v)
    force = MASS * acceleration + friction + OFFSET + more(q) + NOISE * rng.normal(size=len(t))
    return Trial(name=name, role=role, time=t, q=q[:, None], tau=force[:, None])


def axis_header(rate_hz: int, modelled: Sequence[str], names: tuple[str, str]) -> LogHeader:
    """Header of a log of the axis: a trial to fit on and one to judge by."""
    files = zip(names, ("identification", "validation"), strict=True)
    return LogHeader.model_validate(
        {
            "schema": "excite.log/1",
            "robot": "axis.urdf",
            "base": "fixed",
            "rate_hz": rate_hz,
            "joints": ["slide"],
            "torque": "motor_side",
            "modelled": list(modelled),
            "trials": [{"file": f"{name}.parquet", "role": role} for name, role in files],
        }
    )


def axis_log(
    folder: Path, *modelled: str, size: float = 1.0, more: Force = np.zeros_like, base: str = "fixed"
) -> Path:
    """A log of a long trial and a short one, saved; ``size`` is that of the motion, ``more`` a force by position."""
    header = axis_header(RATE_HZ, modelled, ("long", "short")).model_copy(update={"base": base})
    rng = np.random.default_rng(5)
    trials = (
        pushed("long", "identification", 20.0, 0.3, rng, size, more),
        pushed("short", "validation", 4.0, 1.1, rng, size, more),
    )
    return save_log(Log(header, trials, robot_text=URDF), folder / "axis")


def test_what_was_searched_without_a_later_effect_is_searched_again_with_it(tmp_path: Path) -> None:
    """A wide change of sign stands in for viscous friction, and keeps a part of it unless it is searched again."""
    result = diagnose(axis_log(tmp_path, "rigid_body", "torque_bias", size=0.2))
    found = {item.effect: item.parameters for item in result.effects}
    assert found["viscous_friction"]["coefficient"].value == pytest.approx(VISCOUS, rel=0.03)
    assert found["coulomb_friction"]["level"].value == pytest.approx(COULOMB, rel=0.03)


def test_a_constant_force_on_a_slide_is_sized_and_said_to_have_two_names(tmp_path: Path) -> None:
    """On one axis a constant push, and friction that differs by direction, are the same force; in a stand, too."""
    log = axis_log(tmp_path, "rigid_body", "viscous_friction", "coulomb_friction", base="held")
    result = diagnose(log)
    assert result.verdict == "ambiguous"
    assert {"torque_bias", "coulomb_asymmetry"} <= {item.effect for item in result.ambiguous_with}
    assert result.location == "slide"
    assert result.effects[0].parameters["bias"].value == pytest.approx(OFFSET, rel=0.05)
    assert result.gap.share_closed > 0.95
    assert result.simulation is not None
    assert result.simulation.after["slide"] < 0.5 * result.simulation.before["slide"]


@pytest.mark.parametrize("side", [1.0, pytest.param(-1.0, marks=pytest.mark.battery)])
def test_a_stop_is_not_taken_for_a_spring(tmp_path: Path, side: float) -> None:
    """What pushes back beyond an edge alone has no name; where it sets in and how hard it is is said."""

    def stop(q: np.ndarray) -> np.ndarray:
        return side * 800.0 * np.maximum(side * q - 0.06, 0.0)

    result = diagnose(
        axis_log(tmp_path, "rigid_body", "viscous_friction", "coulomb_friction", "torque_bias", more=stop)
    )
    assert (result.verdict, result.location) == ("unknown", "slide")
    told = next(text for text in result.warnings if "edge" in text)
    edge, stiffness = (float(re.search(rf"{word} (\S+)", told)[1]) for word in ("edge", "stiffness"))
    assert edge == pytest.approx(side * 0.06, abs=2e-3)
    assert stiffness == pytest.approx(800.0, rel=0.03)
    assert "N/m" in told


@pytest.mark.parametrize("side", [1.0, pytest.param(-1.0, marks=pytest.mark.battery)])
def test_a_spring_that_is_slack_on_one_side_is_named(tmp_path: Path, side: float) -> None:
    """What pulls back over half of the travel is no stop."""

    def spring(q: np.ndarray) -> np.ndarray:
        return side * 300.0 * np.maximum(side * q + 0.01, 0.0)

    result = diagnose(
        axis_log(tmp_path, "rigid_body", "viscous_friction", "coulomb_friction", "torque_bias", more=spring)
    )
    assert (result.verdict, result.effect, result.location) == ("effect", "joint_spring", "slide")
    found = result.candidates[0].parameters
    assert found["stiffness"].value == pytest.approx(300.0, rel=0.03)
    assert found["edge"].value == pytest.approx(-side * 0.01, abs=3e-3)


def test_a_spring_that_hardens_is_not_taken_for_a_stop(tmp_path: Path) -> None:
    """Its torque grows faster towards an end of the travel, but it never lets go."""

    def spring(q: np.ndarray) -> np.ndarray:
        x = q + 0.1
        return 60.0 * x * (1.0 + 40.0 * x**2)

    result = diagnose(
        axis_log(tmp_path, "rigid_body", "viscous_friction", "coulomb_friction", "torque_bias", more=spring)
    )
    assert (result.verdict, result.effect, result.location) == ("effect", "joint_spring", "slide")


def test_a_motion_is_sought_for_a_robot_of_one_joint(tmp_path: Path) -> None:
    """Two rivals on one axis: of one velocity, numerical libraries return vectors where others have matrices."""

    def spring(q: np.ndarray) -> np.ndarray:
        return 30.0 * q

    log = load_log(axis_log(tmp_path, "rigid_body", "viscous_friction", "coulomb_friction", more=spring))
    samples = arm_samples(nominal_robot(log), log, log.trials)
    floor = spectral_floor(samples)
    baseline = fit_baseline(samples, log.header.modelled, floor)
    tried = [fitted(baseline, EFFECTS[name], "slide") for name in ("torque_bias", "joint_spring")]
    scorer = Scorer(baseline, floor, 0.0, np.ones(1))
    rivals = [scorer.score_fit(baseline.fit, item) for item in tried]
    found = propose_motion(baseline, rivals, floor, seed=0)
    assert found is None or found.motion.q.shape[1] == 1
