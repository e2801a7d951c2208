"""Planting of one known effect in a recording, and least squares by hand that say whether it can be seen.

Nothing of the package's diagnosis is used: the equations are pinocchio's, the filters scipy's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.optimize import lsq_linear
from scipy.signal import butter, sosfiltfilt

from benchmarks.planted.machines import Array, Machine, Recording

# Planted effects, and the term of the model that would hide each.
TERM = {
    "torque_gain": None,
    "torque_bias": "torque_bias",
    "coulomb_friction": "coulomb_friction",
    "viscous_friction": "viscous_friction",
    "time_delay": None,
    "base_tilt": None,
    "encoder_offset": None,
    "joint_spring": None,
    "payload": None,
    "position_gain": None,
    "torque_crosstalk": None,
    "coupled_drive": None,
}
# Those that least squares by hand try in the place of another.
_RIVALS = tuple(TERM)[:9]
TERMS = ("viscous_friction", "coulomb_friction", "armature", "torque_bias")
_OF_JOINT = (
    "torque_gain",
    "torque_bias",
    "coulomb_friction",
    "viscous_friction",
    "encoder_offset",
    "joint_spring",
    "position_gain",
    "torque_crosstalk",
    "coupled_drive",
)
_OF_TWO_JOINTS = ("torque_crosstalk", "coupled_drive")
# Delay, zero of an encoder and gain are those of faults that were met; the rest is drawn.
_DELAY, _ZERO, _GAIN = 0.012, 0.03, 0.15


@dataclass(frozen=True)
class Effect:
    """What is planted.

    Attributes:
        name: of the effect.
        joint: index of its joint; of what is no joint's, 0 (−1 for the last body).
        size: gain's error, N·m, N·m·s/rad, s, rad, N·m/rad or kg.
        direction: of a tilt's axis, the centre of a load in its link [m], or a coupling's ratio.
    """

    name: str
    joint: int
    size: float
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)


class Bench:
    """A machine whose recordings are moved onto its nominal bodies.

    What the nominal bodies and the friction terms cannot explain, noise and unmodelled effects, stays as recorded:
    only the difference between the bodies fitted on the teaching rows and the nominal ones is taken out of the torques.
    """

    def __init__(self, machine: Machine):
        self.machine = machine
        whole = pin.buildModelFromXML(machine.urdf(machine.source))
        locked = [whole.getJointId(n) for n in whole.names[1:] if n not in machine.joints]
        self.model = pin.buildReducedModel(whole, locked, pin.neutral(whole))
        if tuple(self.model.names[1:]) != machine.joints:
            raise ValueError(f"{machine.name}: joints of the model are {list(self.model.names[1:])}")
        self.model.gravity.linear = np.array(machine.gravity)
        self.data = self.model.createData()
        raw = machine.read(machine.source)
        self.runs = raw
        fits = self._fit_bodies(raw)
        self.runs = [Recording(run.q, run.tau - part) for run, part in zip(raw, fits, strict=True)]

    def states(self, q: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations behind the low-pass."""
        smooth = self.filtered(q)
        v = np.gradient(smooth, axis=0) * self.machine.rate_hz
        return smooth, v, np.gradient(v, axis=0) * self.machine.rate_hz

    def filtered(self, x: Array) -> Array:
        """Zero-phase low-pass, ``(n_samples, …)``."""
        sos = butter(4, self.machine.cutoff_hz, fs=self.machine.rate_hz, output="sos")
        return np.asarray(sosfiltfilt(sos, x, axis=0), dtype=float)

    def _moved(self, run: Recording, q: Array, v: Array, a: Array, model: pin.Model | None = None) -> Array:
        model = model or self.model
        data = model.createData()
        return np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])

    def _fit_bodies(self, runs: Sequence[Recording]) -> list[Array]:
        """Torques of fitted less nominal bodies, by run; every row weighs by its joint's spread."""
        blocks, teach, left = [], [], []
        spread = self.filtered(runs[0].tau).std(axis=0)
        for run in runs:
            q, v, a = self.states(run.q)
            rows = np.array(
                [
                    pin.computeJointTorqueRegressor(self.model, self.data, *row).reshape(self.model.nv, -1)
                    for row in zip(q, v, a, strict=True)
                ]
            )
            blocks.append(rows)
            terms = self.terms(v, a, TERMS)
            y = self.filtered(run.tau) - self._moved(run, q, v, a)
            keep = self.teaching(len(q))
            full = np.concatenate([rows, terms], axis=2)[keep] / spread[:, None]
            teach.append(full.reshape(-1, full.shape[2]))
            left.append((y[keep] / spread).reshape(-1))
        columns, y = np.concatenate(teach), np.concatenate(left)
        scale = np.linalg.norm(columns, axis=0) + 1e-12
        # Directions that the motion hardly shows stay nominal; frictions and rotors stay what can exist.
        n_bodies, n_free = blocks[0].shape[2], self.model.nv
        low = np.full(columns.shape[1], -np.inf)
        low[n_bodies:-n_free] = 0.0
        stay = 1e-2 * np.diag(np.arange(len(scale)) < n_bodies)
        made = lsq_linear(
            np.concatenate([columns / scale, stay]), np.r_[y, np.zeros(len(scale))], (low, np.inf)
        )
        delta = made.x / scale
        return [rows @ delta[:n_bodies] for rows in blocks]

    def teaching(self, n: int) -> npt.NDArray[np.intp]:
        """Every tenth of a cut-off's period of the first two thirds, without the filter's ends."""
        step = max(1, int(self.machine.rate_hz / (10.0 * self.machine.cutoff_hz)))
        edge = int(self.machine.rate_hz / self.machine.cutoff_hz)
        return np.arange(edge, 2 * n // 3 - edge, step)

    def judging(self, n: int) -> npt.NDArray[np.intp]:
        """The same of the last third."""
        step = max(1, int(self.machine.rate_hz / (10.0 * self.machine.cutoff_hz)))
        edge = int(self.machine.rate_hz / self.machine.cutoff_hz)
        return np.arange(2 * n // 3 + edge, n - edge, step)

    def terms(self, v: Array, a: Array, names: Sequence[str]) -> Array:
        """Columns of the model's terms at every joint, ``(n_samples, n_joints, n_terms n_joints)``."""
        shapes = {
            "viscous_friction": v,
            "coulomb_friction": np.tanh(v / (0.02 * np.abs(v).max(axis=0) + 1e-9)),
            "armature": a,
            "torque_bias": np.ones_like(v),
        }
        made = [shapes[name][:, :, None] * np.eye(v.shape[1]) for name in names]
        return np.concatenate(made, axis=2) if made else np.zeros((*v.shape, 0))

    def without(self, term: str | None) -> list[Recording]:
        """Recordings from which one term of the model is taken out at every joint, by least squares."""
        if term is None:
            return list(self.runs)
        columns, y, shapes = [], [], []
        others = [name for name in TERMS if name != term]
        for run in self.runs:
            q, v, a = self.states(run.q)
            shape = self.terms(v, a, [term])
            shapes.append(shape)
            keep = self.teaching(len(q))
            both = np.concatenate([shape, self.terms(v, a, others)], axis=2)[keep]
            columns.append(both.reshape(-1, both.shape[2]))
            y.append((self.filtered(run.tau) - self._moved(run, q, v, a))[keep].reshape(-1))
        found = np.linalg.lstsq(np.concatenate(columns), np.concatenate(y), rcond=None)[0]
        n = shapes[0].shape[2]
        return [Recording(r.q, r.tau - s @ found[:n]) for r, s in zip(self.runs, shapes, strict=True)]

    def plant(self, runs: Sequence[Recording], effect: Effect) -> list[Recording]:
        """The recordings with one effect more."""
        return [self._planted(run, effect) for run in runs]

    def _planted(self, run: Recording, effect: Effect) -> Recording:
        q, tau, j, size = run.q.copy(), run.tau.copy(), effect.joint, effect.size
        if effect.name == "torque_gain":
            tau[:, j] *= 1.0 + size
        elif effect.name == "torque_bias":
            tau[:, j] += size
        elif effect.name == "joint_spring":
            tau[:, j] += size * q[:, j]
        elif effect.name == "encoder_offset":
            q[:, j] += size
        elif effect.name == "position_gain":
            q[:, j] *= 1.0 + size
        elif effect.name == "torque_crosstalk":
            tau[:, j] += size * tau[:, j - 1]
        elif effect.name == "time_delay":
            t = np.arange(len(q)) / self.machine.rate_hz
            tau = np.column_stack([np.interp(t - size, t, column) for column in tau.T])
        else:
            smooth, v, a = self.states(run.q)
            if effect.name == "coupled_drive":
                ratio = effect.direction[0]
                turns = v[:, j] + ratio * v[:, j - 1]
                rub = size * np.tanh(turns / (0.02 * np.abs(turns).max() + 1e-9))
                tau[:, j] += rub
                tau[:, j - 1] += ratio * rub
            elif effect.name in {"coulomb_friction", "viscous_friction"}:
                tau += size * self.terms(v, a, [effect.name])[:, :, j]
            else:
                tau += self._moved(run, smooth, v, a, self._other(effect)) - self._moved(run, smooth, v, a)
        return Recording(q, tau)

    def _other(self, effect: Effect) -> pin.Model:
        """The model with gravity turned, or with a load at its last body."""
        model = self.model.copy()
        if effect.name == "base_tilt":
            turn = pin.exp3(effect.size * np.array(effect.direction))
            model.gravity.linear = turn @ np.array(self.machine.gravity)
        else:
            # A ball: 2/5 m r² with r of 5 cm.
            inertia = 0.4 * effect.size * 0.05**2 * np.eye(3)
            model.inertias[model.njoints - 1] += pin.Inertia(effect.size, np.array(effect.direction), inertia)
        return model

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that the machine can have."""
        return tuple(name for name in TERM if len(self.machine.joints) > 1 or name not in _OF_TWO_JOINTS)

    def draw(self, name: str, rng: np.random.Generator) -> Effect:
        """An effect of a usual size at a place that moves."""
        n = len(self.machine.joints)
        q, tau = (np.concatenate([getattr(run, what) for run in self.runs]) for what in ("q", "tau"))
        first = int(name in _OF_TWO_JOINTS)
        j = int(rng.integers(first, n)) if name in _OF_JOINT else 0
        level = float(rng.uniform(0.15, 0.3) * tau[:, j].std())
        sign = float(rng.choice([-1.0, 1.0]))
        angle = rng.uniform(0.0, 2.0 * np.pi)
        across = pin.exp3(angle * np.array(self.machine.gravity) / 9.81) @ _normal(self.machine.gravity)
        mass = sum(body.mass for body in self.model.inertias.tolist()[1:])
        speed = self.states(self.runs[0].q)[1][:, j].std()
        effects = {
            "torque_gain": Effect(name, j, _GAIN),
            "torque_bias": Effect(name, j, sign * level),
            "coulomb_friction": Effect(name, j, level),
            "viscous_friction": Effect(name, j, level / speed),
            "time_delay": Effect(name, 0, _DELAY),
            "base_tilt": Effect(name, 0, rng.uniform(0.05, 0.08), tuple(across)),
            "encoder_offset": Effect(name, j, sign * _ZERO),
            "joint_spring": Effect(name, j, level / q[:, j].std()),
            "payload": Effect(name, -1, 0.05 * mass, tuple(rng.uniform(-0.08, 0.08, 3))),
            "position_gain": Effect(name, j, sign * rng.uniform(0.02, 0.06)),
            "torque_crosstalk": Effect(name, j, sign * rng.uniform(0.08, 0.15)),
            "coupled_drive": Effect(name, j, level, (sign, 0.0, 0.0)),
        }
        return effects[name]

    def residual(self, runs: Sequence[Recording]) -> Array:
        """Filtered torques less those of the nominal bodies, all runs, ``(n_samples, n_joints)``."""
        made = []
        for run in runs:
            q, v, a = self.states(run.q)
            made.append(self.filtered(run.tau) - self._moved(run, q, v, a))
        return np.concatenate(made)

    def look(self, clean: Sequence[Recording], planted: Sequence[Recording], effect: Effect) -> Sight:
        """Least squares with the true column, and with each rival's, on rows held out."""
        modelled = [name for name in TERMS if name != TERM[effect.name]]
        states = [self.states(run.q) for run in planted]
        terms = np.concatenate([self.terms(v, a, modelled) for _, v, a in states])
        ends = np.cumsum([0, *(len(run.q) for run in planted)])
        teach, judge = (
            np.concatenate([start + rows(len(run.q)) for start, run in zip(ends, planted, strict=False)])
            for rows in (self.teaching, self.judging)
        )
        y, before = self.residual(planted), self.residual(clean)
        std = y[teach].std(axis=0) + 1e-9

        def fit(signal: Array, extra: Array) -> tuple[Array, Array]:
            """Mean squares left of the judging rows by joint, and what is explained of all rows."""
            columns = np.concatenate([terms, extra], axis=2) / std[:, None]
            flat = columns[teach].reshape(-1, columns.shape[2])
            found = np.linalg.lstsq(flat, (signal / std)[teach].reshape(-1), rcond=None)[0]
            explained = columns @ found
            left = ((signal / std - explained)[judge] ** 2).mean(axis=0)
            return np.asarray(left), np.asarray(explained * std)

        nothing = np.zeros((*y.shape, 0))
        (base, of_planted), (ideal, of_clean) = fit(y, nothing), fit(before, nothing)

        def take(runs: Sequence[Recording], signal: Array, explained: Array, other: Effect) -> Array:
            """What a column leaves by joint; columns of torques are of predicted ones, which hold no noise."""
            moved = [self.filtered(run.tau) for run in runs]
            predicted = np.concatenate(moved) - signal + explained
            if other.name in {"torque_gain", "time_delay", "torque_crosstalk"}:
                made = [
                    Recording(run.q, part)
                    for run, part in zip(runs, np.split(predicted, ends[1:-1]), strict=True)
                ]
                shifted = [run.tau for run in self.plant(made, other)]
                column = np.concatenate(shifted) - predicted
            else:
                column = self.residual(self.plant(runs, other)) - signal
            return fit(signal, column[:, :, None])[0]

        own = take(planted, y, of_planted, effect)
        place = effect.joint if effect.name in _OF_JOINT else int(np.argmax(base - ideal))
        gain = max(float((base - own).sum()), 1e-12)
        # What a rival takes of the machine's own leftovers says nothing of what was planted.
        rng = np.random.default_rng(0)
        rivals = [
            _at(self.draw(name, rng), effect) for name in _RIVALS if name not in {effect.name, *modelled}
        ]
        best = max(
            float((base - take(planted, y, of_planted, rival)).sum())
            - max(0.0, float((ideal - take(clean, before, of_clean, rival)).sum()))
            for rival in rivals
        )
        closes, share = (float(1.0 - what[place] / base[place]) for what in (own, ideal))
        return Sight(self.machine.joints[place], closes, best / gain, share)


@dataclass(frozen=True)
class Sight:
    """What least squares by hand see of an effect on rows held out.

    Attributes:
        channel: joint at which it shows most, or its own.
        closes: share of that joint's mean square that the true column takes.
        rival: what the best other column takes of all joints, as a share of what the true one takes.
        share: of the joint's mean square that planting added.
    """

    channel: str
    closes: float
    rival: float
    share: float

    @property
    def visible(self) -> bool:
        """Whether a careful reader would name it: a tenth of the joint at least, and a tenth more than any rival."""
        return self.closes >= 0.1 and self.rival <= 0.9


def _at(rival: Effect, effect: Effect) -> Effect:
    """A rival of a joint stands at the effect's joint, where it is nearest to it."""
    own = effect.joint if effect.name in _OF_JOINT else rival.joint
    return Effect(rival.name, own if rival.name in _OF_JOINT else rival.joint, rival.size, rival.direction)


def _normal(gravity: Sequence[float]) -> Array:
    """Some unit vector across gravity."""
    down = np.array(gravity)
    across = np.cross(down, np.roll(down, 1))
    return np.asarray(across / np.linalg.norm(across), dtype=float)
