"""The simulator with effects in it, and the motion that tells rivals apart, on a practice arm without effects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from excite.diagnosis.attribute import Attributor
from excite.diagnosis.augmented import augmented_model
from excite.diagnosis.augmented_effects import Found
from excite.diagnosis.augmented_plant import fitted_plant, physical_plant
from excite.diagnosis.baseline import Baseline, fit_baseline
from excite.diagnosis.effects.effect import Context
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.hypotheses import Hypothesis, at_rows
from excite.diagnosis.next_experiment import expected_evidence, within_record
from excite.diagnosis.next_experiment_paths import retraced
from excite.diagnosis.noise_floor import spectral_floor
from excite.diagnosis.rollout import Simulator
from excite.diagnosis.rollout_drives import PositionServo, Window
from excite.diagnosis.samples import ArmSamples, arm_samples
from excite.identification.inertia import pseudo_inertia_matrices
from excite.logs.files import load_log
from excite.logs.log import Log, LogHeader, Trial
from excite.logs.robot import nominal_robot
from excite.logs.signals.differentiate import central_differences
from excite.regressor.kernels import inverse_dynamics

MODELLED = ("rigid_body", "viscous_friction", "coulomb_friction", "armature")


@pytest.fixture(scope="module")
def baseline(gap_dir: Path) -> Baseline:
    log = load_log(gap_dir / "arm" / "case_022")
    trials = [*log.trials[:3], log.trials[5]]
    samples = arm_samples(nominal_robot(log), log, trials)
    return fit_baseline(samples, MODELLED, spectral_floor(samples))


def test_physical_plant_keeps_the_torques_that_the_record_shows(baseline: Baseline):
    wanted = fitted_plant(baseline)
    plant = physical_plant(baseline, wanted)
    assert np.linalg.eigvalsh(pseudo_inertia_matrices(wanted.phi))[:, 0].min() < 0.0
    assert np.linalg.eigvalsh(pseudo_inertia_matrices(plant.phi))[:, 0].min() > 0.0
    assert min(plant.viscous.min(), plant.coulomb.min(), plant.armature.min()) >= 0.0
    assert plant.mismatch < 0.3


def test_written_model_has_the_dynamics_of_the_plant_with_its_effects(baseline: Baseline):
    """MuJoCo's inverse dynamics of the XML, loaded again, against pinocchio's."""
    effects = [
        Found("joint_spring", "panda_joint2", {"stiffness": 3.0, "torque_at_zero": -1.5}),
        Found("encoder_offset", "panda_joint4", {"offset": 0.05}),
    ]
    model = mujoco.MjModel.from_xml_string(augmented_model(baseline, effects).xml)
    plant = physical_plant(baseline, fitted_plant(baseline))
    samples, data = baseline.samples, mujoco.MjData(model)
    model.dof_frictionloss[:] = 0.0
    for k in range(0, 2000, 400):
        q, v, a = (samples.stacked(name)[k] for name in ("q", "v", "a"))
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        true = q - 0.05 * np.eye(7)[3]
        body = inverse_dynamics(samples.robot.model, true[None], v[None], a[None], plant.phi)[0]
        expected = body + plant.viscous * v + plant.armature * a
        expected[1] += 3.0 * q[1] - 1.5
        assert data.qfrc_inverse == pytest.approx(expected, rel=1e-4, abs=1e-3)


def test_retraced_motions_stay_on_the_record_within_its_speeds(baseline: Baseline):
    samples = baseline.samples
    path = samples.trials[0].q
    most = np.minimum(1.25 * np.abs(samples.stacked("v")).max(axis=0), samples.robot.limits.velocity)
    motions = retraced(samples, 1)
    assert len({m.name for m in motions}) == len(motions) >= 4
    for motion in motions:
        assert (np.abs(motion.v) <= 1.001 * most).all()
        away = [np.abs(path - q).max(axis=1).min() for q in motion.q[:: len(motion.q) // 15]]
        assert max(away) < 0.03


def test_accelerations_stay_within_the_models_limits_or_the_records(baseline: Baseline):
    samples = baseline.samples
    shown = np.abs(samples.stacked("a")).max(axis=0)
    stated = replace(samples.robot.limits, acceleration=np.full(7, 2.0))
    silent = replace(samples.robot.limits, acceleration=np.full(7, 1000.0))
    known, unknown = (replace(samples, robot=replace(samples.robot, limits=x)) for x in (stated, silent))
    for motion in retraced(known, 1):
        assert (np.abs(motion.a) <= 2.0).all()
    for motion in retraced(unknown, 1):
        assert (np.abs(motion.a) <= shown).all()
    assert (within_record(known).limits.acceleration < 2.0).all()


def _hypothesis(baseline: Baseline, name: str, place: str, beta: list[float]) -> Hypothesis:
    context, effect = Context(baseline), EFFECTS[name]
    columns = at_rows(context, effect.shape(context, place, ()))
    fit = baseline.solver.fit(columns.extra, columns.offset)
    return Hypothesis(effect, place, (), columns, replace(fit, extra=np.array(beta)), baseline)


@pytest.mark.slow
def test_the_proposed_motion_separates_a_simulated_pair(baseline: Baseline):
    """A spring on joint 1 against a tilted base: run in MuJoCo on the motion, the spring is then named alone."""
    samples, stiffness, zero = baseline.samples, 0.6, 0.2
    spring = _hypothesis(baseline, "joint_spring", "panda_joint1", [stiffness, zero])
    tilt = _hypothesis(baseline, "base_tilt", "base", [0.2, 0.2, 0.0, 0.0])
    floor = spectral_floor(samples)
    motions = retraced(samples, 1)
    evidence = [expected_evidence(baseline, [spring, tilt], m, floor) for m in motions]
    motion = motions[int(np.argmax(evidence))]
    assert max(evidence) > 30.0
    found = Found("joint_spring", "panda_joint1", {"stiffness": stiffness, "torque_at_zero": zero})
    simulator = Simulator(augmented_model(baseline, [found]).xml, samples.joints)
    kp = np.array([600.0, 600.0, 400.0, 400.0, 80.0, 60.0, 30.0])
    ahead = inverse_dynamics(samples.robot.model, motion.q, motion.v, motion.a, baseline.phi)
    drive = PositionServo(motion.time, motion.q, motion.v, ahead, kp, kp / 12.0)
    steps = np.arange((len(motion.time) - 1) * 4) / (4.0 * samples.rate_hz)
    q = simulator.run(Window(motion.q[0], motion.v[0], ahead[0], steps, 600.0), drive, 4)
    tau = kp * (motion.q - q) + kp / 12.0 * (motion.v - central_differences(q, samples.rate_hz).first) + ahead
    rng = np.random.default_rng(0)
    tau = tau + 0.05 * rng.standard_normal(tau.shape)
    half = len(q) // 2
    trials = [
        Trial("new_a", "identification", motion.time, q, tau=tau),
        Trial("new_b", "validation", motion.time[:half], q[:half], tau=tau[:half]),
    ]
    for trial in samples.trials[:3]:
        force = stiffness * trial.q[:, 0] + zero
        more = np.zeros_like(trial.tau)
        more[:, 0] = force
        role = "identification" if trial.identification else "validation"
        trials.append(Trial(trial.name, role, trial.time, trial.q, tau=trial.tau + more))
    log = header_of(samples)
    again = arm_samples(samples.robot, log, trials)
    noise = spectral_floor(again)
    attribution = Attributor(fit_baseline(again, MODELLED, noise), noise).run()
    assert [(a.name, a.location) for a in attribution.accepted][:1] == [("joint_spring", "panda_joint1")]


def header_of(samples: ArmSamples) -> Log:
    """A log with the header that sampling asks for."""
    header = LogHeader.model_validate(
        {
            "schema": "excite.log/1",
            "robot": "robot.urdf",
            "base": "fixed",
            "rate_hz": samples.rate_hz,
            "joints": samples.joints,
            "torque": "motor_side",
            "trials": [{"file": "new_a.parquet", "role": "identification"}],
        }
    )
    return Log(header, ())
