"""Mistakes in joint torques: unit, side of the gear, sign, delay, an unknown load, another machine."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from excite.arrays import Array
from excite.display import percent, span
from excite.doctor.channel_mapping import OWN_SHARE, Reading
from excite.doctor.doubt import Doubt
from excite.doctor.inertial_prior import FLOOR, half_log
from excite.doctor.limit_shares import share_of_limits
from excite.doctor.mistakes.mistake import THE_UNIT, Correction, Mistake, Samples
from excite.doctor.model_comparison import beside_drives, drive_fit
from excite.doctor.torque_samples import TorqueSamples
from excite.finding import list_names
from excite.regressor.kernels import joint_torque_regressor

# Torques in another unit, or on the other side of the gear.

_SCALE_OFF = 1.6
# A joint alone is told from the others where its factor is beyond what any gain of a sensor is.
_ONE_OFF = 2.5
# Joints whose model makes so large a share of the torque tell the factor.
_TELLS = 0.05
# Factors of the joints that tell lie so near to their median, as logarithm. Wrong masses and loads give every joint a
# factor of its own, so what they differ by is also at most this share of what they have in common: the load that a
# real arm carried made factors of 1.1 to 2.2, whose median is no unit.
_AGREES, _STANDS_OUT = 0.35, 0.5
# Squared correlation with the nominal torque beside friction, and how far beyond one all factors have to be, as
# logarithm: of ten real robots whose torques are N·m those that agree so closely have factors of 0.57 to 1.9, one
# servo arm's to 3.5.
_CLOSELY, _FAR = 0.9, float(np.log(3.0))


def find_torque_scale(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """All torques, or one joint's, larger or smaller than the nominal masses need."""
    gains, shares = samples.gains(reading)
    joints = samples.channels
    told = (shares > _TELLS) & (gains > 0.0)
    own = _of_their_own(samples, reading, gains, told)
    if own is not None:
        yield own
        return
    # A few joints that are off carry something that the model does not have.
    if 2 * told.sum() >= len(joints) and (told.sum() > 1 or len(joints) == 1):
        factor = float(np.median(gains[told]))
        spread = float(np.abs(np.log(gains[told] / factor)).max()) if factor > 0.0 else np.inf
        alike = spread < min(_AGREES, _STANDS_OUT * abs(np.log(factor)))
        if alike and not 1.0 / _SCALE_OFF < factor < _SCALE_OFF:
            cause = (
                "currents, another unit, or torques before the gear"
                if factor < 1.0
                else "another unit, or a load that the model does not have"
            )
            text = (
                f"torques are {factor:.3g} times what the nominal masses need, and so will be every identified "
                f"parameter: {cause}"
            )
            scaled = reading.with_torque(range(len(joints)), 1.0 / factor)
            yield Correction(
                scaled,
                text,
                joints,
                {"factor": factor},
                surprise=abs(float(np.log(factor))),
                ask=THE_UNIT,
                as_logged=lambda read: read.with_torque(range(len(joints)), factor),
                certain=False,
            )
    if len(joints) == 1:
        return
    for j in np.flatnonzero(told):
        # What an end of the range cuts off makes a torque smaller, by the share of rows in which it does where
        # values are spread as in a bell (Bussgang 1952). That is no unit.
        uncut = gains[j] / samples.within[j]
        if 1.0 / _ONE_OFF < uncut and gains[j] < _ONE_OFF:
            continue
        text = f"the torque of {joints[j]} is {gains[j]:.3g} times what the nominal masses need, unlike the others'"
        scaled = reading.with_torque([int(j)], 1.0 / float(gains[j]))
        yield Correction(scaled, text, (joints[j],), {"factor": float(gains[j])}, certain=False)


TORQUE_SCALE = Mistake[TorqueSamples](
    "torque_scale", find_torque_scale, leaves=frozenset({Doubt.SIZE}), may_surprise=True
)


def _of_their_own(
    samples: TorqueSamples, reading: Reading, gains: Array, told: NDArray[np.bool_]
) -> Correction | None:
    """All torques in a unit that differs from joint to joint; None where they are in none such.

    To repair one of them would leave the others, and to repair all would take the nominal masses for the truth.
    """
    close = told & (samples.agreement(reading) > _CLOSELY)
    joints = samples.channels
    if close.sum() < 2 or 2 * close.sum() < len(joints):
        return None
    limits = np.array([samples.robot.limits.torque[samples.robot.joint_index(joint)] for joint in joints])
    size = np.log(gains[close])
    if share := share_of_limits(gains[close], limits[close]):
        factors, cause = limits / share.whole, f"they look like {share.name} of the joints' limits"
    elif np.ptp(size) > _AGREES and ((size < -_FAR).all() or (size > _FAR).all()):
        factors = 1.0 / np.where(told, gains, np.exp(np.median(size)))
        cause = "currents, whose torque constants are not known, or another unit"
    else:
        return None
    scaled = reading
    for j, factor in enumerate(factors):
        scaled = scaled.with_torque([j], float(factor))
    least, most = float(np.exp(size.min())), float(np.exp(size.max()))
    times = span(f"{least:.3g}", f"{most:.3g}", " to ")
    text = f"torques are {times} times what the nominal masses need, by joint: {cause}"

    def as_logged(read: Reading) -> Reading:
        for j, factor in enumerate(factors):
            read = read.with_torque([j], 1.0 / float(factor))
        return read

    return Correction(
        scaled,
        text,
        joints,
        {f"factor.{joint}": float(1.0 / factor) for joint, factor in zip(joints, factors, strict=True)},
        surprise=float(np.abs(size).max()),
        ask=THE_UNIT,
        as_logged=as_logged,
        certain=False,
    )


# A body that a link carries and the model does not have, beside a scale of the torques: which explains them
# better.

# Half the logarithm of the torques' power that a load has to leave less of than the best scale of every joint does. Two
# arms with loads of 0.3 to 2.7 times their own mass leave 1.5 to 3.1 less (all joints together), with torques that are
# four and five times as large 0.01 less; one kept from a scale by nothing is left to it.
_BETTER = 0.35
_CARRIED_LOAD_PASSES = 5


class Load(NamedTuple):
    """A body that explains torques.

    Attributes:
        joint: the one that moves the link which carries it.
        mass: of it [kg]; 0 where the torques do not tell it.
        left: share of the torques' power that is left beside the drives, the largest of any joint.
        parameters: ``(10·n_segments,)`` what it adds to the model's inertial parameters [SI].
    """

    joint: str
    mass: float
    left: float
    parameters: Array

    def sentence(self) -> str:
        """What it is, in words."""
        size = f"a body of {self.mass:.3g} kg" if self.mass > 0.0 else "a body"
        return f"{size} beyond {self.joint} that the model does not have leaves {percent(100.0 * self.left)} of them"

    def shares(self, samples: TorqueSamples, reading: Reading) -> dict[str, float]:
        """RMS of its torque per that of what the nominal bodies need, by joint."""
        felt = joint_torque_regressor(samples.under(reading.gravity), *samples.motion(reading))
        own = (felt[:, samples.places[samples.measured]] @ self.parameters).std(axis=0)
        needed = np.maximum(samples.predicted(reading).torque.std(axis=0), 1e-300)
        return {f"payload.{joint}": float(x) for joint, x in zip(samples.channels, own / needed, strict=True)}


def carried_load(samples: TorqueSamples, reading: Reading) -> Load | None:
    """The load that explains torques better than any scales of them do; None where none does.

    Beside each joint's offset, friction and rotor either every joint's nominal torque is multiplied by a factor of its
    own, or one link has ten inertial parameters more, of a body with a mass.

    Args:
        samples: torques beside the nominal model's.
        reading: how the channels are read.
    """
    torque, (model, drive) = samples.measured_torque(reading), samples.predicted(reading)
    tree = samples.under(reading.gravity)
    columns = samples.places[samples.measured]
    felt = joint_torque_regressor(tree, *samples.motion(reading))[:, columns]
    kept = [_Beside.of(torque[:, j], [x[:, j] for x in drive]) for j in range(torque.shape[1])]
    nominal = [one.rest(model[:, j]) for j, one in enumerate(kept)]
    scaled = half_log(np.array([one.by_gain(x) for one, x in zip(kept, nominal, strict=True)])).sum()
    found: list[tuple[float, Load]] = []
    for k in range(felt.shape[2] // 10):
        body = felt[:, :, 10 * k : 10 * k + 10]
        parts = [one.rest(body[:, j]) for j, one in enumerate(kept)]
        phi, left = _fitted(kept, nominal, parts)
        weighs = bool(np.abs(body[:, :, 0]).max() > 0.0)
        # What leaves more of a torque than there is of it is no explanation.
        if (weighs and phi[0] <= 0.0) or left.max() >= 1.0:
            continue
        added = np.zeros(felt.shape[2])
        added[10 * k : 10 * k + 10] = phi
        load = Load(tree.names[k + 1], float(phi[0]) if weighs else 0.0, float(left.max()), added)
        found.append((float(half_log(left).sum()), load))
    best = min(found, key=lambda pair: pair[0], default=None)
    return best[1] if best is not None and best[0] < scaled - _BETTER else None


class _Beside(NamedTuple):
    """A joint's torque without what its offset, friction and rotor explain, ``(n,)``, and what takes these out."""

    basis: Array
    torque: Array
    power: float

    @classmethod
    def of(cls, torque: Array, drive: list[Array]) -> _Beside:
        columns = np.column_stack([np.ones(len(torque)), *drive])
        basis, _ = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
        power = max(float(((torque - torque.mean()) ** 2).sum()), 1e-300)
        return cls(basis, torque - basis @ (basis.T @ torque), power)

    def rest(self, values: Array) -> Array:
        return np.asarray(values - self.basis @ (self.basis.T @ values))

    def by_gain(self, model: Array) -> float:
        """Share of the torque's power that its model leaves, whatever its size."""
        along = float(model @ self.torque) ** 2 / max(float(model @ model), 1e-300)
        return max(float(self.torque @ self.torque) - along, 0.0) / self.power


def _fitted(kept: list[_Beside], nominal: list[Array], parts: list[Array]) -> tuple[Array, Array]:
    """Parameters of a body ``(10,)`` and the share of each joint's power that is left, weights by what that is."""
    missing = [one.torque - x for one, x in zip(kept, nominal, strict=True)]
    power = np.array([one.power for one in kept])
    left, phi = np.ones(len(kept)), np.zeros(10)
    for _ in range(_CARRIED_LOAD_PASSES):
        weights = 1.0 / np.sqrt(power * np.maximum(left, FLOOR))
        rows = np.concatenate([w * part for w, part in zip(weights, parts, strict=True)])
        target = np.concatenate([w * x for w, x in zip(weights, missing, strict=True)])
        size = np.maximum(np.linalg.norm(rows, axis=0), 1e-12)
        phi = np.linalg.lstsq(rows / size, target, rcond=1e-8)[0] / size
        left = (
            np.array([((x - part @ phi) ** 2).sum() for x, part in zip(missing, parts, strict=True)]) / power
        )
    return phi, left


# How much of each part of the nominal model is in torques: about one where it is, about nought where it is
# not.


class ModelParts(NamedTuple):
    """Shares of the model's parts, nan where a joint's torque does not tell.

    Attributes:
        joints: those that have a torque.
        weight: ``(n_torques,)`` of the bodies' weight.
        inertia: likewise, of what their inertia asks for.
        friction: RMS of viscous and dry friction per that of what the nominal bodies need, likewise.
    """

    joints: tuple[str, ...]
    weight: Array
    inertia: Array
    friction: Array

    @property
    def told(self) -> NDArray[np.bool_]:
        """Which joints tell anything, ``(n_torques,)``."""
        return np.isfinite(self.weight) | np.isfinite(self.inertia)

    @property
    def largest(self) -> float:
        """The largest share of any part at any joint, either sign; nan where none tells."""
        shares = np.abs(np.concatenate([self.weight, self.inertia]))
        return float(np.nanmax(shares)) if self.told.any() else np.nan

    def said(self) -> str:
        """Shares by joint, in words."""
        told = [
            f"{joint} {' and '.join('?' if np.isnan(x) else f'{x:.2g}' for x in shares)}"
            for joint, *shares in zip(self.joints, self.weight, self.inertia, strict=True)
            if np.isfinite(shares).any()
        ]
        friction = span(f"{np.nanmin(self.friction):.2g}", f"{np.nanmax(self.friction):.2g}", " to ")
        return (
            f"shares of the nominal weight and inertial forces in them: {list_names(told, 3)}; "
            f"friction: {friction} times what the nominal bodies need there"
        )

    def figures(self) -> dict[str, float]:
        """The same as numbers by name."""
        return {
            f"{part}.{joint}": float(share)
            for part, shares in zip(self._fields[1:], self[1:], strict=True)
            for joint, share in zip(self.joints, shares, strict=True)
            if np.isfinite(share)
        }


def parts_in(samples: TorqueSamples, reading: Reading) -> ModelParts:
    """Shares of weight and inertial forces in each torque by least squares, beside the joint's offset, friction, rotor.

    Args:
        samples: torques beside the nominal model's.
        reading: how the channels are read.
    """
    full, drive = samples.predicted(reading)
    still = samples.predicted(replace(reading, gravity=np.zeros(3))).torque
    torque = samples.measured_torque(reading)
    shares = np.full((3, torque.shape[1]), np.nan)
    pairs = [beside_drives(torque, part, drive) for part in (full - still, still)]
    for j, ((own, weight), (_, inertia)) in enumerate(zip(*pairs, strict=True)):
        columns = np.column_stack([weight, inertia])
        fitted = np.linalg.lstsq(columns, own, rcond=None)[0]
        # A part tells its share where all of it would be larger than what nothing explains: that is other physics,
        # alike over whole motions, and no noise.
        told = np.linalg.norm(columns, axis=0) > np.linalg.norm(own - columns @ fitted)
        shares[:2, j] = np.where(told, fitted, np.nan)
        rest = torque[:, j] - np.column_stack([full[:, j] - still[:, j], still[:, j]]) @ fitted
        friction = drive_fit(rest, np.zeros_like(rest), drive.v[:, j], drive.a[:, j])[1]
        if told.any():
            shares[2, j] = friction.std() / full[:, j].std()
    return ModelParts(samples.channels, *shares)


# Another machine than the model's, beside several mistakes in a log: one cause instead of many.
#
# The torques of a robot twice as long as its model look as if they were in another unit and on another clock:
# of links λ times as long and μ times as heavy the weights grow with μ λ and what inertia asks for with μ λ²,
# as in a time that is √λ times as slow (Froude's number). So before several mistakes are believed, it is
# asked whether any bodies at all explain the log as it stands, on the model's joints or on those of one that
# is larger or smaller. A turned sign, an exchanged joint, one torque in another unit they do not explain: no
# mass is negative, and what one joint carries those before it carry, too.

# Point masses on cubes about each joint, half as wide as so many times the distance of its nominal centre of mass, with
# a few centimetres [m] more: corners and middles of the faces. A UR10e's torques so are explained on the joints of a
# UR3, whose links are less than half as long, to 0.6 % of their power, as they are by the UR10e's own model.
_WIDE = (0.5, 1.5, 4.0)
_LEAST_M, _MOST_M = 0.04, 1.0
_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_PLACES = np.vstack([np.zeros(3), *(wide * np.vstack([_CORNERS, np.eye(3), -np.eye(3)]) for wide in _WIDE)])
_PASSES = 4
_TRACE = 1e-9


class OtherMachine(NamedTuple):
    """What explains torques with other bodies than the model's.

    Attributes:
        left: half the logarithm of each torque's share of power that is left, ``(n_torques,)``.
        length: its lengths per those of the model.
    """

    left: Array
    length: float

    @property
    def share(self) -> float:
        """Share of the torques' power that is left, geometric mean."""
        return float(np.exp(2.0 * self.left.mean()))


def other_machine(samples: TorqueSamples, stated: Reading, tick: float) -> OtherMachine:
    """The best of all bodies on the model's joints, or on joints as far apart as a clock would have them.

    Args:
        samples: torques with the motion that they belong to.
        stated: how the log states its channels.
        tick: seconds of a unit of the stamps by which the model's own lengths would do.
    """
    made = (
        OtherMachine(left_by_any_bodies(samples, replace(stated, tick=clock)), (stated.tick / clock) ** 2)
        for clock in dict.fromkeys((stated.tick, tick))
    )
    return min(made, key=lambda other: float(other.left.sum()))


def left_by_any_bodies(samples: TorqueSamples, reading: Reading) -> Array:
    """Half the logarithm of each torque's share of power that the best of all bodies leave, ``(n_torques,)``.

    Bodies are clouds of point masses of whatever size, none negative, beside each joint's offset, friction and rotor.

    Args:
        samples: torques with the motion that they belong to.
        reading: how the channels are read.
    """
    torque, drive = samples.measured_torque(reading), samples.predicted(reading).drive
    tree = samples.under(reading.gravity)
    clouds = _clouds(tree.phi.reshape(-1, 10))
    body = joint_torque_regressor(tree, *samples.motion(reading))[:, samples.places[samples.measured]]
    scale = np.maximum(torque.std(axis=0), 1e-12)
    n, m, k = *torque.shape, clouds.shape[1]
    grams, rights, places = [], [], []
    for j in range(m):
        one = np.ones(n)
        own = np.column_stack([one, -one, *(values[:, j] for values in drive)])
        own = own / np.maximum(np.sqrt((own**2).mean(axis=0)), 1e-12)
        rows = np.column_stack([body[:, j] @ clouds / scale[j], own])
        grams.append(rows.T @ rows / n)
        rights.append(rows.T @ (torque[:, j] / scale[j]) / n)
        places.append(np.r_[np.arange(k), k + own.shape[1] * j + np.arange(own.shape[1])])
    powers, size = ((torque / scale) ** 2).mean(axis=0), int(places[-1][-1]) + 1
    shares = np.full(m, 0.1)
    for _ in range(_PASSES):
        matrix, right = np.zeros((size, size)), np.zeros(size)
        for weight, place, gram, side in zip(
            1.0 / np.maximum(shares, FLOOR), places, grams, rights, strict=True
        ):
            matrix[place[:, None], place] += weight * gram
            right[place] += weight * side
        unit = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
        root = np.linalg.cholesky(matrix / np.outer(unit, unit) + _TRACE * np.eye(size))
        x = scipy.optimize.nnls(root.T, np.linalg.solve(root, right / unit), maxiter=20 * size)[0] / unit
        parts = [x[place] for place in places]
        shares = np.array(
            [powers[j] - 2.0 * part @ rights[j] + part @ grams[j] @ part for j, part in enumerate(parts)]
        )
    return half_log(shares)


def _clouds(phi: Array) -> Array:
    """Inertial parameters of all bodies per unit of each point mass, ``(10·n_segments, n)``, from nominal ``phi``."""
    arm = np.linalg.norm(phi[:, 1:4], axis=1) / np.maximum(phi[:, 0], 1e-9)
    clouds = np.zeros((len(phi), 10, len(phi), len(_PLACES)))
    for k, size in enumerate(np.minimum(arm, _MOST_M) + _LEAST_M):
        r = size * _PLACES
        inertia = (r**2).sum(axis=1)[:, None, None] * np.eye(3) - r[:, :, None] * r[:, None, :]
        moments = [inertia[:, a, b] for a, b in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
        clouds[k, :, k] = np.array([np.ones(len(r)), *r.T, *moments])
    return clouds.reshape(10 * len(phi), -1)


# Torques that were logged long after, or before, the positions that they belong to.

# Buses are late by up to 20 ms or so, and logged commands early by a drive's lag, some 50 ms where it is slow: a
# diagnosis names these ``time_delay`` and ``actuator_lag``. What is later or earlier comes from another computer's
# clock, or from columns that were put together wrongly [s].
_LATE_S, _EARLY_S = 0.03, 0.08
_GRID_S = np.arange(-25, 26) * 0.02
# Files of two loggers whose clocks began at zero differ by what a person takes to start the second one [s]. A motion
# that repeats itself agrees one period later, too: at every joint that tells 0.35 nat more have to go. Of a UR10 whose
# torques were logged from 1.5 s on 4.1 nats go at three joints.
_FAR_S, _FAR_NATS = np.arange(-50, 51) * 0.1, 0.35


def find_delay(samples: Samples, reading: Reading) -> Iterable[Correction]:
    """The shift at which the torques agree with the motion."""
    if reading.late_s != 0.0:
        return

    # Friction that builds up over a way after each reversal looks late, too; weights and inertia do not.
    tells = samples.tells(reading)
    if not tells.any():
        return

    def left(late: float) -> float:
        return float(samples.left(replace(reading, late_s=float(late)))[tells].sum())

    scores = [left(late) for late in _GRID_S]
    best, around = float(_GRID_S[int(np.argmin(scores))]), 0.02
    shortest = float((samples.last - samples.first).min()) / samples.rate_hz
    seconds = _FAR_S[np.abs(_FAR_S) + 0.1 <= (1.0 - OWN_SHARE) * shortest]
    far = [left(late) for late in seconds]
    if far and min(far) < min(scores) - _FAR_NATS * float(tells.sum()):
        best, around = float(seconds[int(np.argmin(far))]), 0.1
    bounds = (best - around, best + around)
    if -_EARLY_S < bounds[0] and bounds[1] < _LATE_S:
        return
    best = float(
        scipy.optimize.minimize_scalar(left, bounds=bounds, method="bounded", options={"xatol": 5e-4}).x
    )
    if -_EARLY_S < best < _LATE_S:
        return
    which = "late" if best > 0.0 else "early"
    text = f"{samples.measured_name} look {1e3 * abs(best):.0f} ms {which} beside the positions"
    yield Correction(
        replace(reading, late_s=best),
        text,
        (samples.measured_name,),
        {"late_s": best},
        certain=False,
    )


# Torques with their sign turned: reaction instead of action, or a drive that counts the other way.

# Half the residual's logarithm by which a single turned torque has to fit better to go with the others.
_TORQUE_SIGN_TELLS = 0.3


def find_torque_sign(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Friction takes power out and weights pull down: a turned torque can be neither."""
    joints = samples.channels
    straight = samples.left(reading)
    turned = samples.left(reading.with_torque(range(len(joints)), -1.0))
    gains = straight - turned
    telling = np.flatnonzero(gains > _TORQUE_SIGN_TELLS)
    chosen = {(int(j),) for j in telling} | ({tuple(telling.tolist())} if len(telling) else set())
    # Joints that do not tell go with the others where all that tell agree.
    if len(telling) > 1 and (gains > -_TORQUE_SIGN_TELLS).all():
        chosen.add(tuple(range(len(joints))))
    for places in sorted(chosen):
        names = tuple(joints[j] for j in places)
        text = (
            "the sign of all torques looks turned: reaction instead of action"
            if len(names) == len(joints) > 1
            else f"the sign of the torque of {list_names(names)} looks turned"
        )
        yield Correction(
            reading.with_torque(list(places), -1.0),
            text,
            names,
            {"joints": float(len(names))},
            along=tuple(joints[j] for j in places if j not in telling),
        )


# Weight that a driver takes off torques by its own model before it reports them, as UR's, Kinova's, Doosan's
# do.


def find_missing_weight(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Torques hold the bodies' inertial forces, and nothing of their weight but what the driver's model had wrong."""
    if reading.weightless or not reading.gravity.any():
        return
    parts = parts_in(samples, reading)
    weights = parts.weight[np.isfinite(parts.weight)]
    # Every joint that tells is nearer to none of it than to all.
    if not len(weights) or (np.abs(weights) > 0.5).any():
        return
    bare = replace(reading, weightless=True)
    text, load = (
        f"a driver has taken the weight off the torques ({parts.said()})",
        carried_load(samples, bare),
    )
    if load is not None:
        text += f"; of a payload, it has not: {load.sentence()}"
    yield Correction(
        bare,
        text,
        ("gravity",),
        parts.figures() | ({} if load is None else load.shares(samples, reading)),
        mends="gravity is taken as [0, 0, 0], and what the rest tells is identified; "
        "`excite doctor LOG --repair DIR` adds the nominal weight instead",
    )
