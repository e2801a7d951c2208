"""One case with a little of everything: simulated with all, without each and with each alone, and logged once."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from excite.blind.arm import Arm, arm_of
from excite.blind.case import log_session, noise_of, recordings_of
from excite.blind.detectability import Band
from excite.blind.everything.draw import Ingredient, Mixture
from excite.blind.everything.shares import left_over, true_shares
from excite.blind.forms import OWN_TERMS
from excite.blind.hidden import Answer, HiddenEffect, JointGap
from excite.blind.magnitudes import MAKERS, Site
from excite.logs.log import Log
from excite.robot.loading import load_robot
from excite.simulation.recording import Recording
from excite.simulation.sensing import log_header
from excite.simulation.virtual_robot import VirtualRobot

# A gap that is a thousandth of the noise's power in the band is none.
_NO_GAP = 1e-3


def build_mixture(plan: Mixture, rng: np.random.Generator) -> tuple[Log, Answer]:
    """Simulate one case.

    Args:
        plan: what it is to have.
        rng: source of the arm, its motions and its noise.

    Returns:
        Its log and what is hidden in it, with the true shares of every joint's gap.
    """
    arm = arm_of(load_robot(plan.robot), plan.fixed, rng)
    modelled = ("rigid_body_fixed" if plan.fixed else "rigid_body", *OWN_TERMS)
    everything = range(len(plan.ingredients))

    def simulated(kept: Collection[int]) -> list[Recording]:
        return recordings_of(robot_with(arm, plan.ingredients, kept)[0], arm)

    recordings = simulated(everything)
    sigma = noise_of(recordings, plan.noise)
    band = Band.of(recordings[0], sigma)
    robot = arm.virtual.robot

    def left(runs: list[Recording]) -> np.ndarray:
        return left_over(robot, runs, modelled, band)

    shares = true_shares(
        left(recordings),
        [left(simulated([k for k in everything if k != out])) for out in everything],
        [left(simulated([only])) for only in everything],
        left(simulated([])),
        _NO_GAP * band.noise**2,
    )
    names, open_ = robot.joint_names, shares.gap > 0.0
    hidden = []
    for effect, share in zip(robot_with(arm, plan.ingredients, everything)[1], shares.share, strict=True):
        taken = {name: float(x) for name, x, there in zip(names, share, open_, strict=True) if there}
        hidden.append(replace(effect, shares=taken))
    joints = {
        name: JointGap(float(np.sqrt(gap)), float(noise), float(together))
        for name, gap, noise, together in zip(names, shares.gap, band.noise, shares.together, strict=True)
        if gap > 0.0
    }
    trials, headers = log_session(recordings, arm, plan.noise, plan.faults, sigma, rng)
    header = log_header(robot, headers).model_copy(update={"modelled": modelled})
    log = Log(header=header, trials=trials, robot_text=robot.urdf)
    hidden.sort(key=lambda item: -max(item.shares.values(), default=0.0))
    return log, Answer(
        "everything", plan.robot, modelled, tuple(hidden), plan.noise, plan.faults, joints=joints
    )


def robot_with(
    arm: Arm, ingredients: tuple[Ingredient, ...], kept: Collection[int]
) -> tuple[VirtualRobot, tuple[HiddenEffect, ...]]:
    """The robot with some of the ingredients, each the same whatever the others are; and what those are."""
    virtual = arm.virtual
    hidden: list[HiddenEffect] = []
    for k, item in enumerate(ingredients):
        if k not in kept:
            continue
        rng = np.random.default_rng(item.seed)
        sign = float(rng.choice([-1.0, 1.0]))
        site = Site(virtual, arm, item.effect, item.form, item.joint, item.size, sign, rng)
        virtual, what = MAKERS[item.effect](site)
        hidden.append(what)
    return virtual, tuple(hidden)
