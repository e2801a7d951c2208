"""Friction and rotor inertia that a robot's description states as found: part of the model, not fitted again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.own_columns import ARMATURE, COULOMB, VISCOUS, OwnTerm
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.standstill import fit_where_slipping
from excite.robot.joint_values import per_joint


@dataclass(frozen=True, eq=False)
class KnownTerm:
    """A term of the drives whose size is known.

    Attributes:
        term: the term.
        values: ``(n_joints,)`` its coefficients.
    """

    term: OwnTerm
    values: Array


def known_terms(samples: ArmSamples, modelled: Sequence[str]) -> tuple[KnownTerm, ...]:
    """Terms that the robot's description states as found, and that ``modelled`` does not ask to be fitted."""
    block, names = samples.robot.description.drives, samples.joints
    if not block.found:
        return ()
    zero = np.zeros(len(names))
    stated = {VISCOUS: block.viscous, COULOMB: block.coulomb, ARMATURE: block.armature}
    known = [KnownTerm(term, per_joint(said, names, zero)) for term, said in stated.items()]
    return tuple(item for item in known if item.values.any() and not item.term.is_modelled(modelled))


def subtract_known_torques(samples: ArmSamples, modelled: tuple[str, ...], floor: Array) -> ArmSamples:
    """The samples with torques less those of the terms that are known.

    How dry friction changes sign is the record's: a fit with these terms free, thrown away, tells it.

    Args:
        samples: as measured.
        modelled: words of ``modelled`` in ``log.yaml``.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
    """
    known = known_terms(samples, modelled)
    if not known:
        return samples
    free = fit_where_slipping(samples, (*modelled, *(item.term.words[0] for item in known)), floor)
    led = free.samples
    torque = np.column_stack(
        [
            np.sum([item.values[j] * item.term.column(led, j, sign) for item in known], axis=0)
            for j, sign in enumerate(free.signs)
        ]
    )
    trials = tuple(
        replace(trial, tau=trial.tau - part, known=part)
        for trial, part in zip(samples.trials, samples.by_trial(torque), strict=True)
    )
    return replace(led, trials=trials)
