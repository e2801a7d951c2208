"""A virtual robot compiled once, for one run or many."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.simulation.clock import step_of
from excite.simulation.mjcf import build_spec
from excite.simulation.mjcf_shapes import watch_shapes
from excite.simulation.virtual_robot import VirtualRobot


class Machine:
    """MuJoCo's models of a virtual robot, and how it stood when it had settled last.

    Attributes:
        virtual: the robot.
        step: of its physics [s].
        model: what its physics is computed with.
    """

    def __init__(self, virtual: VirtualRobot, *, watch: bool = False) -> None:
        """Compile the robot; ``watch`` says whether it is to be known which of its shapes overlap."""
        self.virtual, self.step = virtual, step_of(virtual)
        self.model = self._compiled(shapes=False)
        self._watch = _Watch(self._compiled(shapes=True)) if watch else None
        self._settled: tuple[bytes, Any] | None = None

    def touching(self, qpos: Array) -> int:
        """How many pairs of shapes that must not meet overlap in a configuration in MuJoCo's layout."""
        return 0 if self._watch is None else self._watch.touching(qpos)

    def settled(self, start: bytes) -> Any:
        """A copy of the state in which a run that began as ``start`` says had settled; None if it is not known."""
        if self._settled is None or self._settled[0] != start:
            return None
        return copy.copy(self._settled[1])

    def remember(self, start: bytes, data: Any) -> None:
        """Keep the state in which a run that began as ``start`` says has settled: most motions begin at rest."""
        self._settled = (start, copy.copy(data))

    def _compiled(self, *, shapes: bool) -> Any:
        import mujoco

        virtual = self.virtual
        spec = build_spec(
            virtual.robot, virtual.truth.phi, virtual.drives, replace(virtual.world, timestep=self.step)
        )
        for change in virtual.changes:
            change(spec)
        if shapes:
            watch_shapes(spec, virtual.robot)
        model = spec.compile()
        if virtual.robot.feet:
            _damp_as_rotors_do(model)
        if model.ntree == 1:
            # All constraints of one tree of bodies are one island: a step is the same to the last bit without a search
            # for others, and a standing G1's takes a fifteenth less time.
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
        return model


def _damp_as_rotors_do(model: Any) -> None:
    """Take the damping of servos at the end of a step, as the implicit integrator does, but for contacts as well.

    An implicit step solves ``(M + h D) a = f - D v``. MuJoCo's finds contact forces with ``M`` alone, so that soles
    creep where the damping of a step outweighs the inertia of a light foot. With ``h D`` among the rotors' inertia its
    explicit step is the same one, and contacts know of it: tilts of 38 motions of G1, R1 and H1_2 differ by less than
    1 mrad between steps of 1 and of 0.5 ms, and point feet of 27 (Go2, B2, HyQ) slip as far in 1 ms as in 0.25.
    """
    import mujoco

    dof = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    model.dof_armature[dof] -= model.opt.timestep * model.actuator_biasprm[:, 2]
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER


class _Watch:
    """Finds shapes that overlap, in a model of its own: steps of the physics take a seventh longer with 500 pairs."""

    def __init__(self, model: Any) -> None:
        import mujoco

        self._model, self._data = model, mujoco.MjData(model)
        self._place, self._collide = mujoco.mj_kinematics, mujoco.mj_collision

    def touching(self, qpos: Array) -> int:
        self._data.qpos[:] = qpos
        self._place(self._model, self._data)
        self._collide(self._model, self._data)
        return int(self._data.ncon)


def beginning_key(*parts: Array) -> bytes:
    """What tells one beginning of a run from others."""
    return b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
