"""Contact wrenches under another name: turned signs, exchanged feet and axes, another unit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import combinations, permutations, product

import numpy as np

from excite.arrays import Array
from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.mistake import THE_UNIT, Correction, Mistake
from excite.doctor.reading import Reading
from excite.doctor.wrench_samples import WrenchSamples

_COMPONENTS = "xyz"
# Units of force in newtons, and of moments per force in metres, that loggers write.
_FORCES = {"N": 1.0, "kgf": 9.80665, "kN": 1e3, "lbf": 4.4482216}
_LEVERS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}
# A robot weighs what its model says within this factor, loads and all; a unit is near by its logarithm.
_SCALE_OFF, _NEAR = 1.6, 0.3


def _groups(samples: WrenchSamples) -> list[tuple[tuple[int, ...], tuple[str, ...]]]:
    """All sensors, and each one: indices and names."""
    names = samples.sensors
    groups: list[tuple[tuple[int, ...], tuple[str, ...]]] = [((s,), (name,)) for s, name in enumerate(names)]
    return [(tuple(range(len(names))), names), *groups] if len(names) > 1 else groups


class WrenchSign(Mistake[WrenchSamples]):
    """Feet push up: a sensor that reads a pull has its sign turned, or says what the robot does to the ground."""

    name = "wrench_sign"

    def corrections(self, samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
        parts = {"wrench": np.ones(6), "force": np.repeat([1.0, 0.0], 3), "moment": np.repeat([0.0, 1.0], 3)}
        for sensors, names in _groups(samples):
            for what, mask in parts.items():
                other = reading.with_wrenches(sensors, np.diag(1.0 - 2.0 * mask))
                text = f"the sign of the {what} of {' and '.join(names)} looks turned: what the ground feels"
                yield Correction(self.name, other, text, names)


class WrenchOrder(Mistake[WrenchSamples]):
    """Two sensors' columns exchanged: the other foot's."""

    name = "wrench_order"

    def corrections(self, samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
        for i, j in combinations(range(len(samples.sensors)), 2):
            order = reading.sensor_of.copy()
            order[[i, j]] = order[[j, i]]
            maps = reading.wrench_map.copy()
            maps[[i, j]] = maps[[j, i]]
            names = (samples.sensors[i], samples.sensors[j])
            text = f"wrenches of {names[0]} and {names[1]} look exchanged"
            yield Correction(self.name, replace(reading, sensor_of=order, wrench_map=maps), text, names)


class WrenchAxes(Mistake[WrenchSamples]):
    """Axes under other names, with or without a sign: columns in another order, or a frame turned by quarters."""

    name = "wrench_axes"

    def corrections(self, samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
        for sensors, names in _groups(samples):
            for said, matrix in _axes():
                other = reading.with_wrenches(sensors, np.asarray(np.kron(np.eye(2), matrix), dtype=float))
                text = f"axes of {' and '.join(names)} look exchanged: x, y, z are columns {said}"
                yield Correction(self.name, other, text, names)


def _axes() -> Iterator[tuple[str, Array]]:
    """Orders and signs of three axes but for the one as it is and that with all signs turned."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order == (0, 1, 2) and len(set(signs)) == 1:
            continue
        matrix = np.zeros((3, 3))
        matrix[range(3), order] = signs
        said = ", ".join(("-" if s < 0.0 else "") + _COMPONENTS[k] for k, s in zip(order, signs, strict=True))
        yield said, matrix


class WrenchUnit(Mistake[WrenchSamples]):
    """Forces and moments in units other than newtons and metres: the whole weight is known to some tenths."""

    name = "wrench_unit"
    may_surprise = True
    leaves = frozenset({Doubt.SIZE})

    def corrections(self, samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
        everywhere = tuple(range(len(samples.sensors)))
        factor = samples.weight_ratio(reading)
        if factor <= 0.0 or 1.0 / _SCALE_OFF < factor < _SCALE_OFF:
            yield from self._of_moments(samples, reading)
            return
        surprise = abs(float(np.log(factor)))
        near = {name: n for name, n in _FORCES.items() if n > 1.0 and abs(np.log(factor * n)) < _NEAR}
        for force, newtons in near.items():
            for lever, metres in _LEVERS.items():
                other = reading.with_wrenches(everywhere, _scaled(newtons, metres))
                # The moments' unit is told by how the fit is; a price keeps the one that goes with the force.
                worse = float(samples.left(other)[3:].sum())
                unit = f"{force} and {force}·{lever}"
                text = f"wrenches weigh {factor:.3g} times what the robot does: they look like {unit}"
                figures = {"newtons": newtons, "newton_metres": newtons * metres}
                yield Correction(
                    self.name, other, text, samples.sensors, figures, surprise=surprise - 0.01 * worse
                )
        if not near:
            text = f"wrenches weigh {factor:.3g} times what the robot does: another unit, or another robot"
            other = reading.with_wrenches(everywhere, np.eye(6) / factor)
            yield Correction(
                self.name,
                other,
                text,
                samples.sensors,
                {"factor": factor},
                surprise=surprise,
                ask=THE_UNIT,
                as_logged=lambda read: read.with_wrenches(everywhere, factor * np.eye(6)),
                certain=False,
            )

    def _of_moments(self, samples: WrenchSamples, reading: Reading) -> Iterator[Correction]:
        """Moments alone in another unit."""
        for lever, metres in _LEVERS.items():
            if metres != 1.0:
                other = reading.with_wrenches(range(len(samples.sensors)), _scaled(1.0, metres))
                text = f"moments of {' and '.join(samples.sensors)} look like N·{lever}"
                yield Correction(self.name, other, text, samples.sensors, {"newton_metres": metres})


def _scaled(newtons: float, metres: float) -> Array:
    """What turns a wrench in a unit into one in newtons and newton metres."""
    return np.diag(np.repeat([newtons, newtons * metres], 3))
