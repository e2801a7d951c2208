"""The excitation trajectory of Xu et al. 2020, section IV.B: eq. (8) under (10), condition number (9) small.

``python -m tests.reproduction.iiwa_excitation`` designs it (a minute) and writes the coefficients beside this
file; the other modules read them.
"""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from excite.arrays import Array
from excite.motion.generators.curves import FourierCurve
from excite.motion.generators.joint_motions import amplitude_scale, start_conditions
from tests.reproduction.iiwa import HARMONICS, N_JOINTS, PERIOD_S, iiwa, published_base, rows

COEFFICIENTS = Path(__file__).with_name("iiwa_excitation.csv")
OMEGA = 2.0 * np.pi / PERIOD_S
_SAMPLES = 64


@cache
def excitation() -> FourierCurve:
    """One period of the designed trajectory."""
    with COEFFICIENTS.open(encoding="utf-8") as file:
        table = np.array([[float(cell) for cell in row] for row in list(csv.reader(file))[1:]])
    return FourierCurve(np.zeros(N_JOINTS), table[:, :HARMONICS], table[:, HARMONICS:], OMEGA)


def condition(curve: FourierCurve, samples: int = 1000) -> float:
    """``cond(Y_b)`` of eq. (9), columns as in Table 4, unscaled."""
    time = np.arange(samples) * PERIOD_S / samples
    regressor = rows(curve.evaluate(time), curve.evaluate(time, 1), curve.evaluate(time, 2))
    columns = [item.column for item in published_base()]
    return float(np.linalg.cond(regressor.reshape(-1, regressor.shape[2])[:, columns]))


def design(seed: int = 0, starts: int = 200, refined: int = 3) -> FourierCurve:
    """Best of some random series, refined by a quasi-Newton method on the logarithm of the condition."""
    rng = np.random.default_rng(seed)
    bases = [_null_space(matrix) for matrix in start_conditions(OMEGA, HARMONICS)]
    n_a = N_JOINTS * bases[0].shape[1]
    limits = iiwa().limits

    def curve(x: Array) -> FourierCurve:
        a = x[:n_a].reshape(N_JOINTS, -1) @ bases[0].T
        b = x[n_a:].reshape(N_JOINTS, -1) @ bases[1].T
        factor = amplitude_scale(a, b, OMEGA, limits.position_upper, limits.velocity)[:, None]
        return FourierCurve(np.zeros(N_JOINTS), factor * a, factor * b, OMEGA)

    def cost(x: Array) -> float:
        return float(np.log(condition(curve(x), _SAMPLES)))

    draws = rng.standard_normal((starts, n_a + N_JOINTS * bases[1].shape[1]))
    order = np.argsort([cost(x) for x in draws])[:refined]
    found = [minimize(cost, draws[k], method="L-BFGS-B", options={"maxiter": 40}) for k in order]
    return curve(min(found, key=lambda result: result.fun).x)


def _null_space(matrix: Array) -> Array:
    return np.linalg.svd(matrix)[2][len(matrix) :].T


def main() -> None:
    """Design and write."""
    curve = design()
    with COEFFICIENTS.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        numbers = range(1, HARMONICS + 1)
        writer.writerow([*(f"a{k}" for k in numbers), *(f"b{k}" for k in numbers)])
        writer.writerows([[f"{x:.12g}" for x in row] for row in np.hstack([curve.a, curve.b])])
    print(f"condition number {condition(curve):.1f} (published 156.3), coefficients in {COEFFICIENTS.name}")


if __name__ == "__main__":
    main()
