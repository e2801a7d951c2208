"""Mistakes in joint torques: unit, side of the gear, sign, delay, an unknown load, another machine."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from excite.arrays import Array, Flags
from excite.display import percent, span
from excite.doctor.channel_mapping import OWN_SHARE, Reading
from excite.doctor.inertial_prior import STRONG_ODDS, half_log, left_of_channels, normal_equations
from excite.doctor.model_comparison import Columns, fit_parts, remove_drives
from excite.doctor.samples import Correction, Samples, minimize_near
from excite.doctor.thresholds import THRESHOLD, is_near_one
from excite.doctor.torque_samples import TorqueSamples
from excite.finding import list_names

# A body that a link carries and the model does not have, beside a scale of the torques: which explains them better.


class Load(NamedTuple):
    """A body that explains torques.

    Attributes:
        joint: the one that moves the link which carries it.
        mass: of it [kg]; 0 where the torques do not tell it.
        left: share of the torques' power that is left beside the drives, the largest of any joint.
        score: half the logarithm of what is left of each joint's power, in sum.
        parameters: ``(10·n_segments,)`` what it adds to the model's inertial parameters [SI].
    """

    joint: str
    mass: float
    left: float
    score: float
    parameters: Array

    def sentence(self) -> str:
        """What it is, in words."""
        size = f"a body of {self.mass:.3g} kg" if self.mass > 0.0 else "a body"
        left = percent(100.0 * self.left)
        return f"{size} beyond {self.joint} that the model does not have leaves {left} unexplained"

    def shares(self, samples: TorqueSamples, reading: Reading) -> dict[str, float]:
        """RMS of its torque per that of what the nominal bodies need, by joint."""
        own = (samples.felt(reading) @ self.parameters).std(axis=0)
        needed = np.maximum(samples.predicted(reading).torque.std(axis=0), 1e-300)
        return {f"payload.{joint}": float(x) for joint, x in zip(samples.channels, own / needed, strict=True)}


def best_load(
    samples: TorqueSamples, reading: Reading, *, still: bool = False, absent: bool = False
) -> Load | None:
    """The load that explains torques better than any scales of them do; None for none.

    Beside each joint's offset, friction and rotor either every joint's nominal torque is multiplied by a factor of its
    own, or one link has ten inertial parameters more, of a body with a mass, or its weight alone; or the
    weight of an ``absent`` one less, which a controller is told to be in the hand.
    """
    target = samples.measured_torque(reading) - samples.predicted(reading).torque
    columns, tree = samples.body_columns(reading, still=still or absent), samples.under(reading.gravity)
    sums, _ = remove_drives(columns.sums_with(target))
    phi, left = _fit_together(sums, samples.product_sums(reading)[:, 4, 4])
    scores, weighs = half_log(left).sum(axis=1), np.asarray(columns.sums[:, :, 3, 3].any(axis=1))
    # What leaves more of a torque than there is of it is no explanation, nor is a body that the robot's links, end to
    # end, and the widest of bodies do not reach.
    masses = phi[:, 0] * (1 - 2 * absent)
    reach = THRESHOLD.widest_cloud_m + float(np.linalg.norm(tree.translations, axis=1).sum())
    near = np.linalg.norm(phi[:, 1:4], axis=1) <= reach * masses
    others = absent & np.isin(np.arange(len(phi)), tree.parents[1:] - 1)
    good = (~weighs | ((masses > 0.0) & near)) & (left.max(axis=1) < 1.0) & ~others
    k = int(np.argmin(np.where(good, scores, np.inf)))
    if not good[k] or scores[k] >= samples.gains(reading).left.sum() - THRESHOLD.better_load:
        return None
    added = np.zeros_like(phi)
    added[k] = phi[k]
    mass = abs(float(phi[k, 0])) if weighs[k] else 0.0
    return Load(tree.names[k + 1], mass, float(left[k].max()), float(scores[k]), added.ravel())


def _left_beside(samples: TorqueSamples, reading: Reading, load: Load | None) -> float:
    """Half the logarithm of what a load, or else scales, leave of each joint's power, in sum."""
    return float(samples.gains(reading).left.sum()) if load is None else load.score


def _fit_together(sums: Array, power: Array) -> tuple[Array, Array]:
    """Sizes of parts of all torques ``(…, k)`` and the share of each joint's power that is left, by which they weigh.

    Args:
        sums: ``(…, m, k + 1, k + 1)`` of products of parts, such as ten inertial parameters of a body, and of what they
            have to explain.
        power: ``(m,)`` that shares are of.
    """
    some, left = np.maximum(power, 1e-150), np.ones(sums.shape[:-2])
    for _ in range(5):
        weights = 1.0 / (some * np.maximum(left, THRESHOLD.least_share))
        whole = (weights[..., None, None] * sums).sum(axis=-3)
        size = np.sqrt(np.maximum(np.einsum("...ii->...i", whole)[..., :-1], 1e-300))
        gram = whole[..., :-1, :-1] / size[..., None] / size[..., None, :]
        back = np.linalg.pinv(gram, rcond=THRESHOLD.dead_share, hermitian=True)
        x = (back @ (whole[..., :-1, -1] / size)[..., None])[..., 0] / size
        z = np.insert(-x, x.shape[-1], 1.0, axis=-1)
        left = np.einsum("...i,...mij,...j->...m", z, sums, z) / some
    return x, left


# How much of each part of the nominal model is in torques: about one where it is, about nought where it is not.


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
    def told(self) -> Flags:
        """Which joints tell anything, ``(n_torques,)``."""
        return np.isfinite(self.weight) | np.isfinite(self.inertia)

    def size(self, needed: Array) -> float:
        """The largest share of any joint; of all by the torques that these need, where inertial forces tell it.

        Weights alone may be small because gravity points elsewhere.

        Args:
            needed: ``(n_torques,)`` of the nominal bodies, RMS [N·m or N].
        """
        shares, told = np.fmax(np.abs(self.weight), np.abs(self.inertia)), np.isfinite(self.inertia)
        if needed[told].sum() > 0.5 * needed.sum():
            return float(np.linalg.norm((shares * needed)[self.told]) / np.linalg.norm(needed[self.told]))
        return float(np.max(shares[self.told], initial=0.0))

    def lack_weight(self, most: float) -> bool:
        """Whether some joint tells its share of the weight, and none that does has more than ``most``."""
        told = np.isfinite(self.weight)
        return bool(told.any() and (np.abs(self.weight[told]) <= most).all())

    def said(self) -> str:
        """Shares by joint, in words."""
        told = [
            f"{joint} {' and '.join('?' if np.isnan(x) else f'{x:.2g}' for x in shares)}"
            for joint, *shares in zip(self.joints, self.weight, self.inertia, strict=True)
            if np.isfinite(shares).any()
        ]
        friction = span(f"{np.nanmin(self.friction):.2g}", f"{np.nanmax(self.friction):.2g}", " to ")
        return (
            f"shares of the nominal weight and inertial forces in each: {list_names(told, 3)}; "
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


def parts_in(samples: TorqueSamples, reading: Reading, load: Load | None = None) -> ModelParts:
    """Shares of weight and inertial forces in each torque by least squares, beside the joint's offset, friction, rotor.

    Args:
        samples: torques beside the nominal model's.
        reading: how the channels are read.
        load: whose torque is taken off first.
    """
    # Shares of what was there before anything was taken off.
    whole = reading.with_weight()
    full, drive, _ = samples.predicted(whole)
    still = samples.predicted(replace(whole, gravity=np.zeros(3))).torque
    torque = samples.measured_torque(reading) + full - samples.predicted(reading).torque
    if load is not None:
        torque = torque - samples.felt(reading) @ load.parameters
    fit = fit_parts(Columns.of(drive, full - still, still).sums_with(torque))
    # A part tells its share where all of it would be larger than what nothing explains: that is other physics, alike
    # over whole motions, and no noise.
    told = fit.bare[:, :2] > fit.left[:, None]
    needed = np.maximum(full.std(axis=0), 1e-300)
    friction = np.where(told.any(axis=1), np.sqrt(fit.friction / len(full)) / needed, np.nan)
    weight, inertia = np.where(told, fit.parts, np.nan).T
    return ModelParts(samples.channels, weight, inertia, friction)


def find_missing_weight(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Torques hold the bodies' inertial forces, and not the whole of their weight.

    Drivers of UR, Kinova and Doosan take it off by their own model before they report torques: off all of them or some,
    in part, or under a gravity that points elsewhere.
    """
    if not reading.gravity.any():
        return
    parts = parts_in(samples, reading)
    if np.isfinite(parts.inertia).any() and (np.nan_to_num(parts.inertia, nan=-1.0) < -0.5).all():
        # The weight, which tells their sign, is off torques that count the other way.
        turned = reading.with_torque(range(len(samples.channels)), -1.0)
        for one in _without_weight(samples, turned, parts_in(samples, turned), None, 0.0):
            text = f"all torques have the opposite sign, and {one.text}"
            yield replace(one, text=text, changes=2)
    if not reading.is_compensated:
        bare = take_weight(reading, reading.gravity)
        load = best_load(samples, bare)
        least = _left_beside(samples, bare, load)
        yield from _without_weight(samples, reading, parts, load, least)
        # A payload beside no weight, or beside all of it, must not explain clearly more.
        others = ((bare, best_load(samples, bare, still=True)), (reading, best_load(samples, reading)))
        least = min(least, *(_left_beside(samples, read, other) for read, other in others))
        for one in (*_without_part(samples, reading, parts), *_without_absent_load(samples, reading, parts)):
            if samples.gains(one.reading).left.sum() < least + THRESHOLD.better_load:
                yield one
    yield from _without_weight_somewhere(samples, reading, parts)


def _without_weight(
    samples: TorqueSamples, reading: Reading, parts: ModelParts, load: Load | None, score: float
) -> Iterable[Correction]:
    """All of the weight is off all torques, but what the driver's model had wrong or does not know of."""
    bare = take_weight(reading, reading.gravity)
    if not parts.lack_weight(0.5):
        # What a load that is still felt adds to the weights hides that none of the bodies' is there.
        parts = parts_in(samples, reading, load)
        # A payload heavier than the robot is the weight of the robot itself.
        heaviest = samples.under(reading.gravity).phi[::10].sum()
        if load is None or load.mass > heaviest or not parts.lack_weight(THRESHOLD.next_to_nothing):
            return
        # A load beside the whole weight, or any scale of it, must not explain as much.
        if score > _left_beside(samples, reading, best_load(samples, reading)) - THRESHOLD.better_load:
            return
    figures = parts.figures()
    text = f"a driver has subtracted the weight from the torques ({parts.said()})"
    # Masses that the driver has wrong, too, leave some of the weight, which no payload has to explain.
    if load is not None and samples.judged(bare).cost > STRONG_ODDS:
        text += f"; the weight of a payload is still in them: {load.sentence()}"
        figures |= load.shares(samples, reading)
    # Bodies that hold nearly all of the inertial forces and nearly nothing of the weight are none.
    whole = np.isfinite(parts.inertia).any() and (np.nan_to_num(parts.inertia, nan=1.0) > 0.5).all()
    clear = whole and parts.lack_weight(THRESHOLD.next_to_nothing)
    surprise = -float(np.log(THRESHOLD.next_to_nothing)) if clear else None
    mends = ADDED if load is not None else WEIGHTLESS
    yield Correction(bare, text, ("gravity",), figures, surprise=surprise, mends=mends)


def _without_part(samples: TorqueSamples, reading: Reading, parts: ModelParts) -> Iterable[Correction]:
    """A share of the weight is off all torques, or the weight under a gravity that points elsewhere.

    The gravity that was taken off is that of least squares over all joints, by what each leaves. A share is told
    beside the inertial forces alone: without them it is any scale of the torques, and so it is beside another clock,
    by which these grow and weights do not, or where every torque has a scale that the model's masses told.
    """
    told = reading.tick == 1.0 and (np.abs(reading.torque_factor) == 1.0).any()
    if not told or not (np.abs(parts.inertia - 1.0) < 0.5).any():
        return
    size = float(np.linalg.norm(reading.gravity))
    taken = _taken_gravity(samples, reading)
    share = float(np.linalg.norm(taken)) / size
    off = float(np.arccos(np.clip(taken @ reading.gravity / max(share * size**2, 1e-12), -1.0, 1.0)))
    tells = THRESHOLD.least_clock**2
    aside = THRESHOLD.least_tilt_rad < off < np.pi - THRESHOLD.least_tilt_rad
    part = float(np.copysign(share, np.pi / 2 - off))
    if not aside:
        # Twice the weight is that of a gravity that points up; no driver adds another share.
        if is_near_one(max(1.0 - part, 1e-9), tells) or (part < 0.0 and not is_near_one(-part, tells)):
            return
        did = "subtracted {} of the weight from" if part > 0.0 else "added {} of the weight to"
        text = f"a driver has {did.format(percent(100.0 * share))} the torques"
        text += "" if part > 0.0 else ": its gravity points up"
        taken = part * reading.gravity
    elif is_near_one(share, tells):
        taken = taken / share
        x, y, z = np.round(taken, 2) + 0.0
        text = (
            f"a driver has subtracted the weight from the torques under a gravity of [{x:.2f}, {y:.2f}, {z:.2f}], "
            f"{np.degrees(off):.0f}° off what the log says"
        )
    else:
        return
    figures = {**parts.figures(), "share": share, "angle_rad": off}
    text += f" ({parts.said()})"
    # Beside all of it, off which nothing is to be chosen, a share has to bring something of its own.
    changes = 1 + (aside or is_near_one(max(part, 1e-9), tells))
    yield Correction(take_weight(reading, taken), text, ("gravity",), figures, changes=changes, mends=ADDED)


def _without_absent_load(samples: TorqueSamples, reading: Reading, parts: ModelParts) -> Iterable[Correction]:
    """The weight of a payload that the driver believes in, and that is not there, is off all torques."""
    for base, what in (
        (reading, "the weight"),
        (take_weight(reading, reading.gravity), "the weight, and that"),
    ):
        load = best_load(samples, base, absent=True)
        if load is not None:
            body = f"a body of about {load.mass:.2g} kg" if load.mass > 0.0 else "a body"
            yield Correction(
                replace(base, absent=-load.parameters),
                f"a driver has subtracted {what} of {body} beyond {load.joint} that is not there, from the torques: "
                "a payload that is set and not carried, or heavier than what is carried",
                ("gravity",),
                {**parts.figures(), "mass_kg": load.mass},
                changes=1 if base is reading else 2,
                mends=ADDED,
            )


def _taken_gravity(samples: TorqueSamples, reading: Reading) -> Array:
    """The gravity under which the nominal weight is missing in all torques, ``(3,)`` [m/s²]."""
    full, drive, _ = samples.predicted(reading)
    still = samples.predicted(replace(reading, gravity=np.zeros(3))).torque
    taken = [still - samples.predicted(replace(reading, gravity=pull)).torque for pull in np.eye(3)]
    columns = Columns.of(drive, full, *taken)
    sums, _ = remove_drives(columns.sums_with(samples.measured_torque(reading)))
    x, _ = _fit_together(sums, sums[:, -1, -1])
    return np.asarray(x[1:] / x[0] if x[0] > 0.0 else np.zeros(3))


def _without_weight_somewhere(
    samples: TorqueSamples, reading: Reading, parts: ModelParts
) -> Iterable[Correction]:
    """The weight, or a share of it, is off the torques of some joints: each by itself, and all that lack it whole."""
    tells, size = THRESHOLD.least_clock**2, np.nan_to_num(parts.inertia, nan=1.0)
    lacks = (np.abs(parts.weight) < THRESHOLD.next_to_nothing) & (size > 0.5)
    less = np.array([not is_near_one(max(x, 1e-9), tells) for x in np.nan_to_num(parts.weight, nan=1.0)])
    part = less & (parts.weight < 1.0) & (np.abs(parts.inertia - 1.0) < 0.5) & ~lacks
    share = np.where(lacks, 1.0, 1.0 - parts.weight)
    sets = [np.flatnonzero(lacks)] if lacks.sum() > 1 else []
    for chosen in (*sets, *np.flatnonzero(lacks | part)[:, None]):
        names = [samples.channels[j] for j in chosen]
        taken = reading.taken.copy()
        taken[chosen] = share[chosen, None] * reading.gravity
        part_of = "" if lacks[chosen].all() else f"{percent(float(100.0 * share[chosen[0]]))} of "
        yield Correction(
            replace(reading, taken=taken),
            f"{part_of}the weight is missing in the torque{'s' * (len(names) > 1)} of {list_names(names)} alone: "
            f"a driver has subtracted it, or a spring or counterweight carries it ({parts.said()})",
            tuple(names),
            parts.figures(),
            changes=len(names),
            mends=ADDED,
        )


ADDED = "the nominal weight was added to the torques; log the measured torques"
WEIGHTLESS = (
    "gravity is taken as [0, 0, 0], and only what the remaining torques determine is identified; "
    "`excite doctor LOG --repair DIR` adds the nominal weight instead"
)
"""What was done about torques without weight: of all bodies' but a payload's it is told beside theirs."""


def take_weight(reading: Reading, gravity: Array) -> Reading:
    """The reading with the weight under a gravity taken off every torque."""
    return replace(reading, taken=np.tile(gravity, (len(reading.taken), 1)))


# Another machine than the model's, beside several mistakes in a log: one cause instead of many.
#
# The torques of a robot twice as long as its model look as if they were in another unit and on another clock:
# of links λ times as long and μ times as heavy the weights grow with μ λ and what inertia asks for with μ λ²,
# as in a time that is √λ times as slow (Froude's number). So before several mistakes are believed, it is
# asked whether any bodies at all explain the log as it stands, on the model's joints or on those of one that
# is larger or smaller. A turned sign, an exchanged joint, one torque in another unit they do not explain: no
# mass is negative, and what one joint carries those before it carry, too.

# Corners and middles of the faces of cubes about each joint, and its middle.
_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_CUBE = np.vstack([_CORNERS, np.eye(3), -np.eye(3)])


class OtherMachine(NamedTuple):
    """What explains torques with other bodies than the model's.

    Attributes:
        left: half the logarithm of each torque's share of power that is left, ``(n_torques,)``.
        length: its lengths per those of the model.
    """

    left: Array
    length: float


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
    clouds = _clouds(samples.under(reading.gravity).phi.reshape(-1, 10))
    target = torque / np.maximum(torque.std(axis=0), 1e-12)
    body = samples.felt(reading) @ clouds / np.maximum(torque.std(axis=0), 1e-12)[:, None]
    one = np.ones_like(torque)
    own = np.stack([one, -one, *drive], axis=2)
    own /= np.maximum(np.sqrt((own**2).mean(axis=0)), 1e-12)
    rows = list(np.concatenate([body, own, target[:, :, None]], axis=2).transpose(1, 2, 0))
    (_, m, k), width = body.shape, own.shape[2]
    size, shares = k + width * m, np.full(m, 0.1)
    places = [np.r_[np.arange(k), k + width * j + np.arange(width), size] for j in range(m)]
    sums = normal_equations(rows, places)
    for _ in range(4):
        whole = np.tensordot(1.0 / np.maximum(shares, THRESHOLD.least_share), sums, 1)
        matrix, right = whole[:-1, :-1], whole[:-1, -1]
        unit = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
        root = np.linalg.cholesky(matrix / np.outer(unit, unit) + THRESHOLD.trace * np.eye(size))
        x = nnls(root.T, np.linalg.solve(root, right / unit), maxiter=20 * size)[0] / unit
        shares = (left_of_channels(rows, places, x) ** 2).mean(axis=0)
    return half_log(shares)


def _clouds(phi: Array) -> Array:
    """Inertial parameters of all bodies per unit of each point mass, ``(10·n_segments, n)``, from nominal ``phi``.

    Cubes are half as wide as so many times the distance of a joint's nominal centre of mass, with some more.
    """
    arm = np.linalg.norm(phi[:, 1:4], axis=1) / np.maximum(phi[:, 0], 1e-9)
    r = np.vstack([np.zeros(3), *(wide * _CUBE for wide in (0.5, 1.5, 4.0))])
    x, y, z = r.T
    moments = [y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y]
    clouds = np.zeros((len(phi), 10, len(phi), len(r)))
    for k, size in enumerate(np.minimum(arm, THRESHOLD.widest_cloud_m) + THRESHOLD.least_cloud_m):
        clouds[k, :, k] = [np.ones(len(r)), *(size * r.T), *(size**2 * np.array(moments))]
    return clouds.reshape(10 * len(phi), -1)


# Torques that were logged long after, or before, the positions that they belong to.


def find_delay(samples: Samples, reading: Reading, late_s: float = THRESHOLD.late_s) -> Iterable[Correction]:
    """The shift at which the torques agree with the motion, where they are later than ``late_s``."""
    # Friction that builds up over a way after each reversal looks late, too; weights and inertia do not.
    tells = samples.tells(reading)
    if reading.late_s != 0.0 or not tells.any():
        return

    def left(late: NDArray[np.floating]) -> Array:
        return np.array([samples.left(replace(reading, late_s=float(one)))[tells].sum() for one in late])

    def is_usual(early: float, late: float) -> bool:
        return -THRESHOLD.early_s < early and late < late_s

    near, far = np.arange(-25, 26) * 0.02, np.arange(-50, 51) * 0.1
    scores = left(near)
    best, step = float(near[int(np.argmin(scores))]), 0.02
    # Files of two loggers whose clocks began at zero differ by what a person takes to start the second one.
    shortest = float((samples.last - samples.first).min()) / samples.rate_hz
    far = far[np.abs(far) + 0.1 <= (1.0 - OWN_SHARE) * shortest]
    away = left(far) if len(far) else scores
    if away.min() < scores.min() - THRESHOLD.far_nats * float(tells.sum()):
        best, step = float(far[int(np.argmin(away))]), 0.1
    if is_usual(best - step, best + step):
        return
    best = minimize_near(left, best, step, 5e-4)
    if not is_usual(best, best):
        which = "late" if best > 0.0 else "early"
        text = f"{samples.what} are {1e3 * abs(best):.0f} ms {which} relative to the positions"
        late = replace(reading, late_s=best)
        yield Correction(late, text, (samples.what,), {"late_s": best}, certain=False)


# Torques with their sign turned: reaction instead of action, or a drive that counts the other way.


def find_torque_sign(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Friction takes power out and weights pull down: a turned torque can be neither."""
    joints, least = samples.channels, THRESHOLD.sign_tells
    everywhere = tuple(range(len(joints)))
    gains = samples.left(reading) - samples.left(reading.with_torque(everywhere, -1.0))
    telling = tuple(np.flatnonzero(gains > least).tolist())
    chosen = {(j,) for j in telling} | ({telling} if telling else set())
    # Joints that do not tell go with the others where all that tell agree.
    if len(telling) > 1 and (gains > -least).all():
        chosen.add(everywhere)
    for places in sorted(chosen):
        names = tuple(joints[j] for j in places)
        text = f"the torque of {list_names(names)} has the opposite sign"
        if len(names) == len(joints) > 1:
            text = "all torques have the opposite sign: reaction instead of action"
        along = tuple(joints[j] for j in places if j not in telling)
        figures = {"joints": float(len(names))}
        yield Correction(reading.with_torque(places, -1.0), text, names, figures, along=along)
