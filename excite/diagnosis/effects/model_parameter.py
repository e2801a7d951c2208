"""A parameter of a MuJoCo model that a person chooses: whatever a callback edits, fitted and named like an effect."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.effect import Effect, Shape, Theta
from excite.diagnosis.effects.form import Context, Form, Sizes
from excite.errors import InputError
from excite.robot.robot import Robot
from excite.simulation.mjcf import World, build_spec
from excite.simulation.true_parameters import nominal_drives

if TYPE_CHECKING:
    from mujoco import MjSpec

# Step of the differences, in the unit of the parameter: torques of 100 N·m are exact to 1e-14, their slope to 1e-8.
_STEP = 1e-6


class ModelParameter(Effect):
    """What :meth:`edit` changes in the robot's MuJoCo model: any field of its ``MjSpec``.

    Its columns are the differences of MuJoCo's inverse dynamics of the edited and of the nominal model over the
    recorded motion, without contacts and limits: the first order at the nominal. ``linear`` names what is edited, in
    units in which a change of a millionth is small and 1 is not out of all proportion.
    """

    by_motion = True
    moves = True
    mujoco = "the edit itself"

    @abstractmethod
    def edit(self, spec: MjSpec, location: str, *values: float) -> None:
        """Change a model by the linear parameters; all zero is the nominal model."""

    def model(self, robot: Robot) -> MjSpec:
        """The nominal model: the robot's, with its links' and joints' names; or of a file that has these joints."""
        return build_spec(robot, robot.nominal_parameters, nominal_drives(robot), World())

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        """See :class:`~excite.diagnosis.effects.effect.Effect`."""
        still = self._edited_torques(context, location, np.zeros(len(self.linear)))
        moved = [self._edited_torques(context, location, step) for step in _STEP * np.eye(len(self.linear))]
        slopes = np.stack([(torques - still) / _STEP for torques in moved], axis=2)
        return Shape(dict(enumerate(slopes.transpose(1, 0, 2))))

    def in_mujoco(self, item: Sizes) -> Form:
        """See :class:`~excite.diagnosis.effects.effect.Effect`."""
        values = [item.value_of(parameter.name) for parameter in self.linear]
        return Form(elements=lambda draft: self.edit(draft.spec, item.location, *values))

    def _edited_torques(self, context: Context, location: str, values: Sequence[float] | Array) -> Array:
        """Torques of the edited model over the record, ``(n_samples, n_joints)`` [N·m]."""
        import mujoco

        samples = context.baseline.samples
        robot = samples.robot
        spec = self.model(robot)
        try:
            self.edit(spec, location, *map(float, values))
            model = spec.compile()
            joints = [model.joint(name) for name in robot.joint_names]
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            said = f"cannot edit the model ({' '.join(str(error).split())})"
            raise InputError(said, source=self.name, field=location, remedy="correct edit") from error
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        data = mujoco.MjData(model)
        place = [int(joint.qposadr[0]) for joint in joints]
        degree = [int(joint.dofadr[0]) for joint in joints]
        torques = np.empty((sum(len(trial.q) for trial in samples.trials), len(joints)))
        for k, (q, v, a) in enumerate(zip(*samples.tree_motion, strict=True)):
            data.qpos[place], data.qvel[degree], data.qacc[degree] = q, v, a
            mujoco.mj_inverse(model, data)
            torques[k] = data.qfrc_inverse[degree]
        return samples.on_motors(torques)
