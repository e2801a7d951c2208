"""Runs the simulator of a standing robot: joints as recorded, the ground's wrenches as logged, the base free."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.equations.state import State
from excite.diagnosis.floating.search.refinement import apply_all
from excite.diagnosis.floating.simulator.noted import read_notes
from excite.diagnosis.simulator.model_text import load_model
from excite.simulation.coordinates import body_name
from excite.simulation.inertial import MASSLESS_KG


class Simulator:
    """A loaded model.

    MuJoCo gives mass matrix and bias forces at every sample; the base's rows of the equation of motion, with
    the joints' accelerations and the sensors' wrenches, its acceleration. The base has no feedback: what the model
    has wrong grows with the square of time. Contacts, joint limits and drives are out of play.
    """

    def __init__(self, xml: str, record: FloatingRecord):
        """Load a model.

        Args:
            xml: the model's text.
            record: the record that it is compared with.
        """
        import mujoco

        self.model = load_model(xml)
        self.data = mujoco.MjData(self.model)
        self.record = record
        self.placed, self.theta = read_notes(self.model, record)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        # What is beyond a sensor is not part of what its reading moves.
        for segment in record.unmeasured:
            body = self.model.body(body_name(record.robot.segments[segment].link)).id
            self.model.body_mass[body] = MASSLESS_KG
            self.model.body_inertia[body] = 1e-3 * MASSLESS_KG
        names = record.robot.joint_names
        self._q = np.array([self.model.joint(name).qposadr[0] for name in names])
        self._v = np.array([self.model.joint(name).dofadr[0] for name in names])
        self._from = np.array([record.tree.names.index(name) for name in names])
        self._sites = {s.name: self.model.site(s.name).id for s in record.robot.sensors}

    @cached_property
    def drive(self) -> State:
        """The record as the model's notes say that it truly was, of the robot that the model says."""
        state = apply_all(self._said(), self.placed, self.theta)
        return state.replace(extra=np.broadcast_to(np.asarray(state.extra, dtype=float), (len(state.q), 6)))

    def _said(self) -> State:
        """The logged motion and readings of the robot with the model's bodies, lengths and sensors."""
        record, model = self.record, self.model
        phi, translations = np.zeros_like(record.tree.phi), record.tree.translations.copy()
        for k, segment in enumerate(record.robot.segments):
            body = model.body(body_name(segment.link))
            axes = pin.Quaternion(*body.iquat).matrix()
            inertia = pin.Inertia(float(body.mass[0]), body.ipos, axes @ np.diag(body.inertia) @ axes.T)
            phi[10 * k : 10 * k + 10] = inertia.toDynamicParameters()
            translations[segment.joint] = body.pos
        placements = {
            sensor.name: pin.SE3(pin.Quaternion(*site.quat).matrix(), site.pos)
            for sensor in record.robot.sensors
            for site in (model.site(sensor.name),)
        }
        tree = replace(record.tree, translations=translations)
        return State.logged(record).replace(tree=tree, phi=phi, placements=placements)

    def run(self, window: slice, noise: Array | None = None, start: Array | None = None) -> Array:
        """Where the base ends up, less where it is, at each sample of a window, ``(n, 6)`` [m, rad].

        Second order in the step (velocity Verlet, with a predicted velocity in the bias forces).

        Args:
            window: its samples.
            noise: ``(n_samples, 6)`` wrench that is added, base frame.
            start: ``(6,)`` velocity that is added at the start, base frame.
        """
        state, step, first = self.drive, 1.0 / self.record.rate_hz, window.start
        extra = np.asarray(state.extra if noise is None else state.extra + noise)
        recorded = state.poses.rotation[:, 1]
        rotation = recorded[first]
        place, speed = state.q[first, :3].copy(), rotation @ state.v[first, :3]
        turning = state.v[first, 3:6].copy()
        if start is not None:
            speed, turning = speed + rotation @ start[:3], turning + start[3:]
        linear, angular = self._accelerated(extra, first, place, rotation, speed, turning)
        out = [np.zeros(6)]
        for k in range(window.start + 1, window.stop):
            place = place + step * speed + 0.5 * step**2 * linear
            rotation = rotation @ pin.exp3(step * turning + 0.5 * step**2 * angular)
            guess, guessed = speed + step * linear, turning + step * angular
            ahead = self._accelerated(extra, k, place, rotation, guess, guessed)
            speed = speed + 0.5 * step * (linear + ahead[0])
            turning = turning + 0.5 * step * (angular + ahead[1])
            linear, angular = ahead
            out.append(np.concatenate([place - state.q[k, :3], pin.log3(recorded[k].T @ rotation)]))
        return np.array(out)

    def _accelerated(
        self,
        extra: Array,
        k: int,
        place: Array,
        rotation: Array,
        speed: Array,
        turning: Array,
    ) -> tuple[Array, Array]:
        """Acceleration of the base's origin, world, and of its rotation, base frame, at a sample."""
        import mujoco

        model, data, state, tree = self.model, self.data, self.drive, self.record.tree
        quaternion = pin.Quaternion(rotation)
        data.qpos[:3] = place
        data.qpos[3:7] = quaternion.w, quaternion.x, quaternion.y, quaternion.z
        data.qvel[:3], data.qvel[3:6] = speed, turning
        data.qpos[self._q] = state.q[k, tree.idx_q[self._from]]
        data.qvel[self._v] = state.v[k, tree.idx_v[self._from]]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        # The base's unit accelerations, and those of the joints.
        moves, forces = np.eye(7, model.nv), np.zeros((7, model.nv))
        moves[6] = 0.0
        moves[6, self._v] = state.a[k, tree.idx_v[self._from]]
        for move, needed in zip(moves, forces, strict=True):
            mujoco.mj_mulM(model, data, needed, move)
        force, moment = rotation @ extra[k, :3], rotation @ extra[k, 3:]
        for name, site in self._sites.items():
            axes = data.site_xmat[site].reshape(3, 3)
            pull = axes @ state.readings[name][k, :3]
            force = force + pull
            moment = moment + axes @ state.readings[name][k, 3:]
            moment = moment + np.cross(data.site_xpos[site] - place, pull)
        wrench = np.concatenate([force, rotation.T @ moment])
        found = np.linalg.solve(forces[:6, :6].T, wrench - data.qfrc_bias[:6] - forces[6, :6])
        return found[:3], found[3:]
