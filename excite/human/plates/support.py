"""When the plates carry the whole person, and what mass they say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError
from excite.finding import Finding
from excite.human.body import Body
from excite.human.plates.force_plates import GRAVITY, PlateReading
from excite.human.posture.skeleton import Placement
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.logs.signals.differentiate import central_differences

_MISSING = 0.35
_SHORTEST_S = 0.1
_MASS_TOLERANCE = 0.05


@dataclass(frozen=True, eq=False)
class Support:
    """What vertical forces say against the weight.

    Attributes:
        frames: the longest span in which the plates carry the whole person.
        mass: from the mean vertical force in it, the change of momentum taken off [kg].
        findings: what was odd.
    """

    frames: slice
    mass: float
    findings: tuple[Finding, ...]


def mass_center(body: Body, placement: Placement) -> Array:
    """Centre of mass of the whole body, ``(n, 3)`` [m]."""
    masses = np.array([inertia.mass for inertia in body.inertias])
    centers = np.stack([inertia.center for inertia in body.inertias])
    points = placement.origin + np.einsum("nkij,kj->nki", placement.rotation, centers)
    return np.einsum("k,nki->ni", masses / masses.sum(), points)


def find_support(
    body: Body, placement: Placement, readings: Sequence[PlateReading], rate_hz: float, source: Path
) -> Support:
    """Find the span in which all contact is on plates, and weigh the person in it.

    Measured vertical force is compared with the weight times one plus the acceleration of the centre of mass;
    where much is missing for longer than a tenth of a second a foot stands beside the plates.

    Raises:
        LogError: at no time do the plates carry the person, or the forces are not in newtons.
    """
    center = mass_center(body, placement)
    cutoff = min(6.0, 0.2 * rate_hz)
    if len(center) > settling_samples(rate_hz, cutoff):
        center = lowpass(center, rate_hz, cutoff, 3)
    motion = central_differences(center, rate_hz)
    weight = body.subject.mass * GRAVITY
    vertical = np.sum([reading.force[:, 2] for reading in readings], axis=0)
    expected = body.subject.mass * (GRAVITY + motion.second[:, 2])
    typical = float(np.median(vertical[expected > 0.5 * weight])) if (expected > 0.5 * weight).any() else 0.0
    if not 0.05 * weight < typical < 20.0 * weight:
        raise LogError(
            f"vertical forces are {typical:.4g} N where the person weighs {weight:.0f} N ({_largest(readings)})",
            source=source,
            field="force plates",
            remedy="check the plates' gains and the person's mass in kilograms: no unit of force makes them agree",
        )
    short = expected - vertical > _MISSING * weight
    carried = _without_short_runs(~short, round(_SHORTEST_S * rate_hz))
    span = _longest_run(carried)
    if span is None:
        raise LogError(
            "the plates carry the person at no time",
            source=source,
            field="force plates",
            remedy="both feet have to stand on plates",
        )
    findings = []
    if span.stop - span.start < len(carried):
        text = (
            f"{source.name}: plates carry the whole person from frame {span.start} to {span.stop} of "
            f"{len(carried)} only; the rest is left out"
        )
        findings.append(Finding("unlogged_contact", text, {"share": float(np.mean(carried))}))
    duration = (span.stop - span.start - 1) / rate_hz
    gained = motion.first[span.stop - 1, 2] - motion.first[span.start, 2]
    mass = float(vertical[span].mean() / (GRAVITY + gained / max(duration, 1e-9)))
    share = mass / body.subject.mass - 1.0
    if abs(share) > _MASS_TOLERANCE:
        text = (
            f"{source.name}: the plates say {mass:.1f} kg, the person weighs {body.subject.mass:.1f} kg "
            f"({100 * share:+.1f} %): check gains, zeros, and what is worn"
        )
        findings.append(Finding("mass", text, {"plates_kg": mass, "given_kg": body.subject.mass}))
    return Support(span, mass, tuple(findings))


def _largest(readings: Sequence[PlateReading]) -> str:
    return ", ".join(f"{one.name} at most {one.force[:, 2].max():.4g}" for one in readings)


def _without_short_runs(flags: NDArray[np.bool_], shortest: int) -> NDArray[np.bool_]:
    """Runs of False shorter than ``shortest`` become True."""
    flags = flags.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~flags, [False]]).astype(int))).reshape(-1, 2)
    for start, stop in edges:
        if stop - start < shortest:
            flags[start:stop] = True
    return flags


def _longest_run(flags: NDArray[np.bool_]) -> slice | None:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int))).reshape(-1, 2)
    if not len(edges):
        return None
    start, stop = max(edges.tolist(), key=lambda edge: edge[1] - edge[0])
    return slice(start, stop)
