"""KUKA LBR iiwa as in Xu et al., IEEE Access 2020: parameters by their names, trajectories, recordings.

The regressor's columns are ten per link in pinocchio's order, then ``viscous`` and ``coulomb`` of the seven
joints: 84 columns, of which 57 base parameters stay.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.formats.documents import read_yaml
from excite.identification.estimators.settings import BodySettings
from excite.identification.inertia import NAMES, physical_parameters, standard_parameters
from excite.identification.physical.bounds import InertiaRules, PhysicalBounds
from excite.identification.physical.bounds_file import load_bounds
from excite.identification.physical.default_bounds import default_bounds
from excite.identification.physical.feasible_set import FeasibleSet
from excite.identification.problem import IdentificationProblem
from excite.regressor.base_parameters import BaseParameters, base_parameters, r_factor
from excite.regressor.columns import PARAMETERS, measured_columns, regressor_rows
from excite.robot.catalogue import data_folder
from excite.robot.loading import load_robot
from excite.robot.robot import Robot

HERE = Path(__file__).parent
N_JOINTS, N_INERTIAL, N_COLUMNS = 7, 70, 84
DRIVES = tuple(f"{term}.joint{k}" for term in ("viscous", "coulomb") for k in range(1, 8))
BOUNDS = data_folder("robots") / "iiwa14" / "physical_bounds.yaml"

# Section IV.B: harmonics, fundamental, sampling, low-pass of the averaged torque.
HARMONICS, PERIOD_S, RATE_HZ, PERIODS = 5, 20.0, 500.0, 20
CUTOFF_HZ, ORDER = 6.0, 4

# Place of the paper's names in a link's ten columns; the paper's XY, XZ, YZ are tensor entries (eq. 14).
_PLACE = {"M": 0, "MX": 1, "MY": 2, "MZ": 3, "XX": 4, "XY": 5, "YY": 6, "XZ": 7, "YZ": 8, "ZZ": 9}


@dataclass(frozen=True)
class PublishedBase:
    """A row of Tables 4 and 5.

    Attributes:
        name: such as ``XX2``.
        regrouped: whether other parameters are grouped with it.
        base: value of Table 4 [SI].
        base_rsd: its RSD [%].
        essential: value of Table 5, None where it was eliminated.
        essential_rsd: its RSD [%].
    """

    name: str
    regrouped: bool
    base: float
    base_rsd: float
    essential: float | None
    essential_rsd: float | None

    @property
    def column(self) -> int:
        """Column of the parameter that stands for it."""
        return column(self.name)


def column(name: str) -> int:
    """Column of a parameter by the paper's name: ``MX3``, ``FV1``, …"""
    kind, number = name[:-1], int(name[-1]) - 1
    if kind in ("FV", "FC"):
        return N_INERTIAL + (N_JOINTS if kind == "FC" else 0) + number
    return 10 * number + _PLACE[kind]


@cache
def published_base() -> tuple[PublishedBase, ...]:
    """Tables 4 and 5, in the order of Khalil's grouping: ``ZZ1``, seven of each later link, friction."""
    with (HERE / "xu2020_tables_4_5.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return tuple(
        PublishedBase(
            row["parameter"],
            row["regrouped"] == "yes",
            float(row["base"]),
            float(row["base_rsd_percent"]),
            float(row["essential"]) if row["essential"] else None,
            float(row["essential_rsd_percent"]) if row["essential_rsd_percent"] else None,
        )
        for row in rows
    )


@cache
def iiwa() -> Robot:
    """The bundled robot, whose frames are those of Table 2."""
    return load_robot("iiwa14")


def rows(q: Array, v: Array, a: Array) -> Array:
    """Regressor of the joint torques with viscous and Coulomb friction, ``(n, 7, 84)`` (eq. 2)."""
    robot = iiwa()
    return regressor_rows(robot, measured_columns(robot), q, v, a)


@cache
def grouping() -> Array:
    """Khalil's grouping ``π_b = G π``, ``(57, 84)``, rows in the order of :func:`published_base`.

    The regrouping of Gautier and Khalil is the one in which the columns of Table 4 stand for the others.
    """
    rng = np.random.default_rng(3)
    q, v, a = rng.uniform(-np.pi, np.pi, (60, 7)), rng.normal(size=(60, 7)), 5.0 * rng.normal(size=(60, 7))
    first = [item.column for item in published_base()]
    order = np.array([*first, *(j for j in range(N_COLUMNS) if j not in first)])
    base: BaseParameters = base_parameters(
        r_factor(rows(q, v, a).reshape(-1, N_COLUMNS)[:, order]), [str(j) for j in order]
    )
    if base.independent.tolist() != list(range(len(first))):
        raise AssertionError("the columns of Table 4 are not independent")
    matrix = np.zeros((len(first), N_COLUMNS))
    matrix[:, order] = base.matrix
    return matrix


@cache
def bounds(path: Path = BOUNDS) -> PhysicalBounds:
    """LB and UB of Tables 6 and 7, eq. (17) and (18)."""
    usual = replace(default_bounds(iiwa(), BodySettings()), rules=InertiaRules())
    return load_bounds(path, iiwa()).over(usual)


def published_parameters(which: str) -> Array:
    """Standard parameters and friction ``(84,)`` of Tables 6 and 7: ``xu2020`` (theirs) or ``ref37``."""
    stated = read_yaml(BOUNDS)["parameters"]
    values = {name: float(entry[which]) for name, entry in stated.items()}
    links = [segment.link for segment in iiwa().segments]
    physical = np.array([[values[f"{link}.{name}"] for name in NAMES] for link in links])
    return np.concatenate([standard_parameters(physical), [values[name] for name in DRIVES]])


def judge(parameters: Array) -> dict[str, float]:
    """Violations of eq. (16) to (18), recomputed from standard parameters and friction ``(84,)``."""
    drives = dict(zip(DRIVES, parameters[N_INERTIAL:].tolist(), strict=True))
    return bounds().violations(physical_parameters(parameters[:N_INERTIAL]), drives, range(N_JOINTS))


def problem(q: Array, v: Array, a: Array, tau: Array) -> IdentificationProblem:
    """Samples as the problem that estimators solve; torques ``(n, 7)`` [N·m]."""
    n = len(q)
    names = [f"{segment.link}.{name}" for segment in iiwa().segments for name in PARAMETERS]
    return IdentificationProblem(
        robot=iiwa(),
        Y=rows(q, v, a).reshape(-1, N_COLUMNS),
        y=tau.ravel(),
        weights=np.ones(n * N_JOINTS),
        channel=np.tile(np.arange(N_JOINTS), n),
        channel_names=iiwa().joint_names,
        channel_units=("N·m",) * N_JOINTS,
        time=np.repeat(np.arange(n) / RATE_HZ, N_JOINTS),
        trial=np.zeros(n * N_JOINTS, dtype=np.int64),
        trial_names=("excitation",),
        parameter_names=(*names, *DRIVES),
        prior=published_parameters("ref37"),
        n_inertial=N_INERTIAL,
    )


def allowed_set(*, principal: bool = False) -> FeasibleSet:
    """What eq. (16) to (18) allow; with ``principal`` only bodies that can exist."""
    known = bounds()
    if principal:
        known = replace(known, rules=known.rules.model_copy(update={"principal_triangle": True}))
    return FeasibleSet(known, DRIVES, np.arange(N_JOINTS), np.zeros(N_INERTIAL))


def coordinates(allowed: FeasibleSet, parameters: Array) -> Array:
    """Coordinates in the set of standard parameters and friction ``(84,)``."""
    return allowed.coordinates(physical_parameters(parameters[:N_INERTIAL]), parameters[N_INERTIAL:])


def allowed_near(parameters: Array) -> Array:
    """Parameters ``(84,)`` of bodies that can exist, within eq. (16) to (18), nearest to given ones."""
    allowed = allowed_set(principal=True)
    return allowed.standard(allowed.nearest(coordinates(allowed, parameters)))
