"""The parameter sets that Xu et al. 2020 compare, identified from a recording of the excitation."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.physical.feasible_set import (
    TorqueObjective,
    base_objective,
    essential_objective,
)
from excite.identification.physical.retrieval import (
    Certificate,
    Relaxation,
    RetrievalSettings,
    descend_locally,
    retrieve_parameters,
)
from excite.regressor.base_parameters import r_factor
from tests.reproduction.iiwa import (
    N_COLUMNS,
    N_INERTIAL,
    N_JOINTS,
    allowed_set,
    coordinates,
    grouping,
    iiwa,
    published_base,
    published_parameters,
)
from tests.reproduction.iiwa_twins import Recorded
from tests.reproduction.momentum_observer import observe_momentum

COLUMNS = np.array([row.column for row in published_base()])
EFFORT = RetrievalSettings(starts=5, seed=0, gap=1e-3, nodes=100)


@dataclass(frozen=True, eq=False)
class Identified:
    """What one recording gives.

    Attributes:
        base: least-squares base parameters, ``(57,)`` in Table 4's order (eq. 6).
        base_rsd: ``(57,)`` relative standard deviations of eq. (7) [%].
        essential: objective of eq. (15), with the indices of the parameters kept.
        essential_rsd: the same of these, ``(len(essential.kept),)`` [%].
        sets: standard parameters and friction ``(84,)`` by method; those of base and essential parameters
            stand in the columns of Table 4, all others zero.
        certificate: of the retrieval.
        seconds: of CPU that the retrieval took, on one thread.
    """

    base: Array
    base_rsd: Array
    essential: TorqueObjective
    essential_rsd: Array
    sets: dict[str, Array]
    certificate: Certificate
    seconds: float


def identify(recorded: Recorded) -> Identified:
    """Base, essential and physical parameters, and the methods of the paper's references [30] and [37]."""
    regressor, torque = recorded.regressor(), recorded.tau.ravel()
    triangle = r_factor(np.column_stack([regressor[:, COLUMNS], torque]))
    n = len(COLUMNS)
    base = np.linalg.solve(triangle[:n, :n], triangle[:n, n])
    inverse = np.linalg.inv(triangle[:n, :n])
    variance = triangle[n, n] ** 2 / (len(torque) - n)
    base_rsd = _rsd(inverse, variance, base)
    essential = essential_objective(triangle, grouping(), len(torque))
    values = np.linalg.lstsq(essential.factor[:, COLUMNS[essential.kept]], essential.target, rcond=None)[0]
    left = np.linalg.qr(essential.factor[:, COLUMNS[essential.kept]], mode="r")
    variance = essential.floor**2 / (len(torque) - len(values))
    essential_rsd = _rsd(np.linalg.inv(left), variance, values)
    allowed = allowed_set()
    center = coordinates(allowed, published_parameters("ref37"))
    start = time.process_time()
    found = retrieve_parameters(essential, allowed, center, EFFORT)
    seconds = time.process_time() - start
    middle = 0.5 * (allowed.bounds.lower + allowed.bounds.upper)
    drives = 0.5 * (allowed.drive_lower + allowed.drive_upper)
    local = Relaxation(
        base_objective(triangle, grouping()),
        allowed,
        1e-6 / allowed.scale,
        allowed.nearest(allowed.coordinates(middle, drives)),
    )
    apart = TorqueObjective(grouping(), base, 0.0, np.arange(n))
    return Identified(
        base=base,
        base_rsd=base_rsd,
        essential=essential,
        essential_rsd=essential_rsd,
        sets={
            "base": _placed(COLUMNS, base),
            "essential": _placed(COLUMNS[essential.kept], values),
            "physical": found.parameters,
            "[30]": retrieve_parameters(
                apart, allowed, center, RetrievalSettings(starts=5, nodes=1)
            ).parameters,
            "[37]": allowed.standard(descend_locally(local, local.center).x),
            "published": published_parameters("xu2020"),
            "published [37]": published_parameters("ref37"),
        },
        certificate=found.certificate,
        seconds=seconds,
    )


def _rsd(inverse: Array, variance: float, values: Array) -> Array:
    """Relative standard deviations of eq. (7) [%]; ``inverse`` is that of the R factor of the rows."""
    return 100.0 * np.sqrt(variance * np.einsum("ij,ij->i", inverse, inverse)) / np.abs(values)


def rms(recorded: Recorded, parameters: Array) -> Array:
    """RMS of measured minus predicted torque of each joint, ``(7,)`` [N·m]."""
    rest = recorded.tau.ravel() - recorded.regressor() @ parameters
    return np.sqrt(np.mean(rest.reshape(-1, N_JOINTS) ** 2, axis=0))


def largest_residual(recorded: Recorded, parameters: Array, gain: float) -> Array:
    """Largest residual of the momentum observer of each joint, ``(7,)`` [N·m]."""
    friction = parameters[N_INERTIAL:].reshape(2, N_JOINTS)
    torque = recorded.tau - friction[0] * recorded.v - friction[1] * np.sign(recorded.v)
    found = observe_momentum(
        iiwa(), recorded.time, recorded.q, recorded.v, torque, parameters[:N_INERTIAL], gain=gain
    )
    return np.abs(found).max(axis=0)


def _placed(columns: Array, values: Array) -> Array:
    parameters = np.zeros(N_COLUMNS)
    parameters[columns] = values
    return parameters
