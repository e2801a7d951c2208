"""RSD predicted from motions and declared noise against RSD found after simulating and identifying."""

from __future__ import annotations

import numpy as np

import excite
from excite.campaign.expected import predict_statistics
from tests.benchmarks.table import Row

_FACTOR = 1.5
# Where a deviation is as large as the value, the value that it is divided by is itself a draw of the noise.
_KNOWN = 20.0
_METHODS = {"ur10": "wls", "g1": "wls"}


def rows() -> list[Row]:
    """Essential parameters of an arm and a humanoid, motions of the library.

    On the model itself everything is predicted. On a robot that differs from its model the standard deviations
    are, but what they are relative to are values that nobody knows before.
    """
    table = []
    for name, method in _METHODS.items():
        robot = excite.load_robot(name)
        motions = excite.load_motions(name)
        predicted = predict_statistics(robot, motions)
        rsd = predicted.essential_rsd()
        std = dict(zip(predicted.base.labels, predicted.std, strict=True))
        roles = {motion.name: "identification" for motion in motions}
        for nominal in (True, False):
            run = excite.simulate(robot, motions, nominal=nominal, roles=roles, seed=5, jobs=2)
            found = excite.identify(robot, run.log, method)
            kept = {item.name for item in found.essential} & rsd.keys()
            ratios = {
                item.name: rsd[item.name] / item.rsd_percent for item in found.base if item.name in kept
            }
            deviations = np.array([std[item.name] / item.std for item in found.base if item.name in std])
            truth = "the model itself" if nominal else "a robot that differs from its model"
            bar = f"within a factor {_FACTOR:g}"
            for which, limit in (("", np.inf), (f" predicted at most {_KNOWN:g} %", _KNOWN)):
                some = np.array([ratio for parameter, ratio in ratios.items() if rsd[parameter] <= limit])
                table.append(
                    Row.holds(
                        f"{name}, {truth}: predicted / found RSD of {len(some)} essential parameters{which}",
                        bar,
                        _spread(some),
                        _worst(some) <= _FACTOR,
                    )
                )
            table.append(
                Row.holds(
                    f"{name}, {truth}: predicted / found standard deviation of {len(deviations)} base parameters",
                    bar,
                    _spread(deviations),
                    _worst(deviations) <= _FACTOR,
                )
            )
    return table


def _worst(ratios: np.ndarray) -> float:
    return float(np.exp(np.abs(np.log(ratios)).max()))


def _spread(ratios: np.ndarray) -> str:
    within = np.mean(np.abs(np.log(ratios)) <= np.log(_FACTOR))
    return f"median {np.median(ratios):.2f}, {ratios.min():.2f} to {ratios.max():.2f}, {100.0 * within:.0f} % within"
