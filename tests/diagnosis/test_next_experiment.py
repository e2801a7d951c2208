"""The simulator with effects in it, and motions along a record's paths, on a practice arm without effects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from excite.diagnosis.effects.gears.backlash import SoftBacklash
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.next_experiment.candidates import limit_to_record, retrace_record
from excite.diagnosis.simulator.augmented_plant import (
    FoundEffect,
    augmented_model,
    physical_plant,
    plant_with,
)
from excite.identification.inertia import pseudo_inertia_matrices
from excite.logs.files import load_log
from excite.logs.robot import nominal_robot
from excite.regressor.kernels import inverse_dynamics

MODELLED = ("rigid_body", "viscous_friction", "coulomb_friction", "armature")


@pytest.fixture(scope="module")
def baseline(gap_dir: Path) -> Baseline:
    log = load_log(gap_dir / "arm" / "case_022")
    trials = [*log.trials[:3], log.trials[5]]
    samples = arm_samples(nominal_robot(log), log, trials)
    return fit_baseline(samples, MODELLED, spectral_floor(samples))


def test_physical_plant_keeps_the_torques_that_the_record_shows(baseline: Baseline):
    wanted = plant_with(baseline, ())
    plant = physical_plant(baseline, wanted)
    assert np.linalg.eigvalsh(pseudo_inertia_matrices(wanted.phi))[:, 0].min() < 0.0
    assert np.linalg.eigvalsh(pseudo_inertia_matrices(plant.phi))[:, 0].min() > 0.0
    assert plant.drives.min() >= 0.0
    assert plant.mismatch < 0.3


def test_written_model_has_the_dynamics_of_the_plant_with_its_effects(baseline: Baseline):
    """MuJoCo's inverse dynamics of the XML, loaded again, against pinocchio's."""
    effects = [
        FoundEffect(EFFECTS["joint_spring"], "panda_joint2", {"stiffness": 3.0, "torque_at_zero": -1.5}),
        FoundEffect(EFFECTS["encoder_offset"], "panda_joint4", {"offset": 0.05}),
    ]
    model = mujoco.MjModel.from_xml_string(augmented_model(baseline, effects).xml)
    plant = physical_plant(baseline, plant_with(baseline, ()))
    samples, data = baseline.samples, mujoco.MjData(model)
    model.dof_frictionloss[:] = 0.0
    for k in range(0, 2000, 400):
        q, v, a = (samples.stack_trials(name)[k] for name in ("q", "v", "a"))
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        true = q - 0.05 * np.eye(7)[3]
        body = inverse_dynamics(samples.robot.model, true[None], v[None], a[None], plant.phi)[0]
        expected = body + plant.drives[0] * v + plant.drives[2] * a
        expected[1] += 3.0 * q[1] - 1.5
        assert data.qfrc_inverse == pytest.approx(expected, rel=1e-4, abs=1e-3)


def test_a_soft_play_hangs_in_the_written_model_where_the_record_loads_it(baseline: Baseline):
    """Under gravity, with its motor held, the gear comes to rest where its law balances the load."""
    width, softness, stiffness = 0.01, 0.002, 3000.0
    sizes = {"width": width, "softness": softness, "stiffness": stiffness, "damping": 20.0, "contact_hz": 8.0}
    model = mujoco.MjModel.from_xml_string(
        augmented_model(baseline, [FoundEffect(SoftBacklash(), "panda_joint4", sizes)]).xml
    )
    data = mujoco.MjData(model)
    motors = [model.joint(name) for name in baseline.samples.joints]
    model.dof_damping[[int(motor.dofadr[0]) for motor in motors]] = 1e6
    q = baseline.samples.trials[0].q[0]
    data.qpos[[int(motor.qposadr[0]) for motor in motors]] = q
    gear = model.joint("panda_joint4.deflection")
    for _ in range(600):
        mujoco.mj_step(model, data)
    x, load = float(data.qpos[gear.qposadr[0]]), float(data.qfrc_bias[gear.dofadr[0]])
    sides = np.logaddexp(0.0, (np.array([1.0, -1.0]) * x - 0.5 * width) / softness)
    assert abs(load) > 1.0
    assert -stiffness * softness * (sides[0] - sides[1]) == pytest.approx(
        load, abs=0.06 * stiffness * softness
    )


def test_retraced_motions_stay_on_the_record_within_its_speeds(baseline: Baseline):
    samples = baseline.samples
    path = samples.trials[0].q
    most = np.minimum(1.25 * np.abs(samples.stack_trials("v")).max(axis=0), samples.robot.limits.velocity)
    motions = retrace_record(samples)
    assert len({m.name for m in motions}) == len(motions) >= 4
    for motion in motions:
        assert (np.abs(motion.v) <= 1.001 * most).all()
        away = [np.abs(path - q).max(axis=1).min() for q in motion.q[:: len(motion.q) // 15]]
        assert max(away) < 0.03


def test_accelerations_stay_within_the_models_limits_or_the_records(baseline: Baseline):
    samples = baseline.samples
    shown = np.abs(samples.stack_trials("a")).max(axis=0)
    stated = replace(samples.robot.limits, acceleration=np.full(7, 2.0))
    silent = replace(samples.robot.limits, acceleration=np.full(7, 1000.0))
    known, unknown = (replace(samples, robot=replace(samples.robot, limits=x)) for x in (stated, silent))
    for motion in retrace_record(known):
        assert (np.abs(motion.a) <= 2.0).all()
    for motion in retrace_record(unknown):
        assert (np.abs(motion.a) <= shown).all()
    assert (limit_to_record(known).limits.acceleration < 2.0).all()
