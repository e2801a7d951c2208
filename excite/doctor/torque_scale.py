"""Torques of another scale than newton metres: a unit, shares of limits, currents, or the other side of the gears."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from excite.arrays import Array, Flags
from excite.display import span
from excite.doctor.channel_mapping import Reading
from excite.doctor.doubt import Doubt
from excite.doctor.inertial_prior import likely_spread
from excite.doctor.model_comparison import Columns, fit_parts, remove_drives
from excite.doctor.samples import THE_UNIT, Correction, Mistake
from excite.doctor.thresholds import THRESHOLD, is_near_one
from excite.doctor.torque_samples import TorqueSamples
from excite.errors import InputError
from excite.finding import list_names
from excite.formats.documents import parse_xml
from excite.logs.units import size_of
from excite.robot.robot import Robot

_UNITS = ("lbf·ft", "lbf·in", "ozf·in", "kgf·m", "kgf·cm", "N·cm", "N·mm", "kN·m")


class Scale(NamedTuple):
    """What torques look like that are not those of the nominal model.

    Attributes:
        factors: ``(n_torques,)`` that undo it.
        times: logged torques per N·m of the nominal model, of the joints that tell.
        cause: in words.
        apart: whether joints have factors of their own, as they follow their model closely.
        far: whether no mass or load is likely to make them: a cause that every joint agrees with, or all far off.
    """

    factors: Array
    times: Array
    cause: str
    apart: bool
    far: bool

    def line(self, joints: Iterable[str]) -> str:
        """``{tau: …}`` of a map that undoes it: one factor where all joints share it, else one a joint."""
        if not self.apart:
            return f"{{tau: {self.factors[0]:.3g}}}"
        pairs = zip(joints, self.factors, strict=True)
        return "{" + ", ".join(f"tau.{joint}: {factor:.3g}" for joint, factor in pairs) + "}"


def find_scale(samples: TorqueSamples, reading: Reading) -> Scale | None:
    """The scale of all torques; None where they are newton metres as far as the nominal masses tell, or nothing tells.

    Joints that follow their model closely tell a factor each. It is compared with what gears and limits of the model
    would make; with none of these, joints that are all far off are in a unit of their own, and joints that lie nearer
    to each other than what they have in common in one unit of all.

    Args:
        samples: torques beside the nominal model's.
        reading: how the channels are read; torques of turned joints tell nothing.
    """
    gains, shares, agreement, _ = samples.gains(reading)
    told = (shares > THRESHOLD.telling_share) & (gains > 0.0)
    close = told & (agreement > THRESHOLD.closely)
    # No load makes every torque that tells anything much smaller: friction may hide the others.
    small = told.sum() >= 2 and gains[told].max() < 1.0 / THRESHOLD.scales_far
    half = 2 * close.sum() >= len(close)
    most = close.sum() >= 2 and (small or half)
    if most:
        size = np.log(gains[close])
        outside = max(size.min(), -size.max()) > np.log(THRESHOLD.scales_far)
        for cause, expected in _causes(samples) if half else ():
            away, own = size - np.log(expected[close]), np.log(expected[close])
            # As logged they agree no less with newton metres, or with one factor, of which there are other causes.
            if np.abs(away).max() < np.log(THRESHOLD.scale_off) <= min(np.abs(size).max(), np.ptp(own)):
                return Scale(1.0 / expected, np.exp(size), cause, apart=True, far=True)
        if outside and (np.ptp(size) > THRESHOLD.scales_agree or not half):
            factors = 1.0 / np.where(told, gains, np.exp(np.median(size)))
            gears = f", torques before gears{likely_gears(samples, reading)}" if size.max() < 0.0 else ""
            cause = f"currents, whose torque constants are not known{gears}, another unit, or another robot's model"
            return Scale(factors, np.exp(size), cause, apart=True, far=True)
    # A few joints that are off carry something that the model does not have.
    if 2 * told.sum() < len(told) or told.sum() < min(2, len(told)):
        return None
    factor = float(np.median(gains[told]))
    spread = float(np.abs(np.log(gains[told] / factor)).max())
    alike = spread < min(THRESHOLD.scales_agree, THRESHOLD.scale_stands_out * abs(np.log(factor)))
    if not alike or is_near_one(factor, THRESHOLD.scale_off):
        return None
    unit = f"another unit{name_units(factor)}"
    cause = f"{unit}, a load that the model does not have, or the model of a smaller robot"
    if factor < 1.0:
        cause = f"currents, {unit}, torques before the gear, or the model of a larger robot"
    return Scale(
        np.full(len(told), 1.0 / factor), np.array([factor]), cause, apart=False, far=most and outside
    )


def name_units(times: float) -> str:
    """Units of torque of which a newton metre has about so many, in words; empty for none."""
    names = [unit for unit in _UNITS if is_near_one(times * size_of(unit), np.exp(0.5 * THRESHOLD.near_unit))]
    return f" ({' or '.join(f'{unit}: {1.0 / size_of(unit):.3g}' for unit in names)})" if names else ""


def likely_gears(samples: TorqueSamples, reading: Reading) -> str:
    """Between which reductions torques before gears would be by likely bodies, in words; empty where none tells.

    A joint tells whose torque holds the model's by more than twice the error of its fit (effective samples), and whose
    model likely bodies and loads change by less than one and a half of it. Both errors widen the range, twice each.
    """
    fit, judged = fit_parts(samples.product_sums(reading)), samples.judged(reading)
    error = 2.0 * np.sqrt(fit.left / np.maximum(judged.counts * fit.bare[:, 0], 1e-300))
    sums, _ = remove_drives(samples.body_columns(reading).sums_with(samples.predicted(reading).torque))
    share = sums[..., :-1, -1] / np.maximum(sums[..., -1:, -1], 1e-300)
    tree = samples.under(reading.gravity)
    spread = likely_spread(tree, THRESHOLD.payload_spread).reshape(len(sums), 1, -1)
    bodies, gain = np.sqrt(((spread * share) ** 2).sum(axis=(0, 2))), fit.parts[:, 0]
    wide, told = 1.0 + 2.0 * bodies, (gain > error) & (bodies < 1.5)
    least, largest = 1.0 / ((gain + error) * wide), wide / np.where(told, gain - error, 1.0)
    each = zip(samples.channels, least, largest, strict=True)
    names = [f"{joint} {low:.0f} to {high:.0f}" for j, (joint, low, high) in enumerate(each) if told[j]]
    return f" (reduction by likely masses and loads: {list_names(names, 3)})" if names else ""


def _causes(samples: TorqueSamples) -> Iterator[tuple[str, Array]]:
    """What makes torques of another size by the model, and how many times as large it makes each, ``(n_torques,)``."""
    gears = gear_ratios(samples.robot)
    ratios = np.array([gears.get(joint, np.nan) for joint in samples.channels])
    if np.isfinite(ratios).all():
        said = ", ".join(f"{joint} {gear:.4g}" for joint, gear in zip(samples.channels, ratios, strict=True))
        yield f"they look like torques before the model's gears, those of motors ({said})", 1.0 / ratios
        yield f"they look like torques with the model's gears applied twice ({said})", ratios
    places = [samples.robot.joint_index(joint) for joint in samples.channels]
    limits = np.asarray(samples.robot.limits.torque, dtype=float)[places]
    if np.isfinite(limits).all():
        for name, whole in (("percent", 100.0), ("per mille", 1000.0), ("shares", 1.0)):
            yield f"they look like {name} of the model's limits of torque", whole / limits


def gear_ratios(robot: Robot) -> Mapping[str, float]:
    """Reductions other than one that ``<transmission>`` elements of a robot's URDF state, by joint."""
    found: dict[str, float] = {}
    for transmission in _find_elements(robot, "transmission"):
        joint, ratio = transmission.find("joint"), transmission.findtext(".//mechanicalReduction", "0")
        if joint is not None and (value := abs(_read_number(ratio))) not in (0.0, 1.0):
            found[joint.get("name", "")] = value
    return found


def stated_friction(robot: Robot, speed: Mapping[str, float]) -> Mapping[str, float]:
    """Dry and viscous friction at a speed that a robot's URDF states, by joint [N·m or N]."""
    each = {joint.get("name", ""): joint.find("dynamics") for joint in _find_elements(robot, "joint")}
    return {
        name: abs(_read_number(said.get("friction", "0")))
        + speed[name] * abs(_read_number(said.get("damping", "0")))
        for name, said in each.items()
        if said is not None and name in speed
    }


def _find_elements(robot: Robot, tag: str) -> Sequence[Element]:
    """Elements of a robot's URDF; none where it cannot be read."""
    try:
        return (
            parse_xml(robot.urdf.encode(), Path("robot.urdf")).findall(tag) if f"<{tag}" in robot.urdf else ()
        )
    except InputError:
        return ()


def _read_number(text: str) -> float:
    number = text.strip().lstrip("+-")
    return float(number) if number.replace(".", "", 1).isdigit() else 0.0


def find_torque_scale(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """All torques, or one joint's, larger or smaller than the nominal masses need."""
    scale, joints = find_scale(samples, reading), samples.channels
    # To repair one of those in units of their own would leave the others, and to repair all would take the nominal
    # masses for the truth.
    if scale is not None:
        size, factors = np.log(scale.times), scale.factors
        times = span(f"{scale.times.min():.3g}", f"{scale.times.max():.3g}", " to ")
        where = "by joint" if scale.apart else "and so will be every identified parameter"
        each = {f"factor.{joint}": float(1.0 / f) for joint, f in zip(joints, factors, strict=True)}
        yield Correction(
            replace(reading, torque_factor=reading.torque_factor * factors),
            f"torques are {times} times what the nominal masses need, {where}: {scale.cause}",
            joints,
            each if scale.apart else {"factor": float(scale.times[0])},
            surprise=float(np.abs(size).max()),
            ask=f"{THE_UNIT}; scale: {scale.line(joints)} in map.yaml makes them the nominal model's",
            as_logged=lambda read: replace(read, torque_factor=read.torque_factor / factors),
            certain=False,
        )
    gains, shares, agreement, _ = samples.gains(reading)
    told = (shares > THRESHOLD.telling_share) & (gains > 0.0)
    alone = len(joints) > 1 and (scale is None or not scale.apart)
    values = np.stack([samples.measured_torque(reading), samples.predicted(reading).torque])
    for j in np.flatnonzero(told) if alone else ():
        # What an end of the range cuts off makes a torque smaller, and no unit: the ends stand where the model's torque
        # is in as many rows, but for the unit. Rows that were chosen by the torque do not bias the slope over it.
        gain, (lower, upper) = float(gains[j]), samples.ends[:, j]
        width = np.ptp(np.quantile(values[:, :, j], [lower, 1.0 - upper], axis=1), axis=0)
        apart = width[0] / max(width[1], 1e-300) if lower + upper > 0.0 else gain / max(agreement[j], 1e-300)
        off = max(gain, apart) <= 1.0 / THRESHOLD.one_scale_off or min(gain, apart) >= THRESHOLD.one_scale_off
        if off and not _holds_neighbours(samples, reading)[j]:
            text = f"the torque of {joints[j]} is {gain:.3g} times what the nominal masses need, unlike the others'"
            scaled = reading.with_torque([int(j)], 1.0 / gain)
            yield Correction(scaled, text, (joints[j],), {"factor": gain}, certain=False)


def _holds_neighbours(samples: TorqueSamples, reading: Reading) -> Flags:
    """Torques that a part of the one before or after them explains beside the model, no worse than a scale does.

    A tenth of what a shoulder carries is several times what a wrist needs.
    """
    torque, (model, drive, _) = samples.measured_torque(reading), samples.predicted(reading)

    def left(values: Array, part: Array) -> Array:
        rest, _ = remove_drives(Columns.of(drive, part).sums_with(values))
        return np.asarray(rest[:, 1, 1] - rest[:, 0, 1] ** 2 / np.maximum(rest[:, 0, 0], 1e-300))

    beside = np.pad(torque, ((0, 0), (1, 1)))
    least = np.minimum(left(torque - model, beside[:, :-2]), left(torque - model, beside[:, 2:]))
    return np.asarray(least < left(torque, model))


TORQUE_SCALE = Mistake("torque_scale", find_torque_scale, leaves=frozenset({Doubt.SIZE}), may_surprise=True)
