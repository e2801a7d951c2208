"""A person of 16 rigid bodies on a force plate: rows as Lee, Wensing and Park publish them (T-RO 2020).

Rows come as a ready regressor, so they become the problem that estimators solve without a log: three rows an
instant, two horizontal moments [N·m] and the vertical force [N] on the plate. The order of the ten parameters and
the body frames are the authors'; how the bodies hang together is not published and not needed.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.identification.estimators.method_settings import estimator_settings
from excite.identification.estimators.registry import find_estimator
from excite.identification.problem import IdentificationProblem
from excite.logs.robot import robot_for_log
from excite.regressor.columns import PARAMETERS
from excite.robot.robot import Robot

FOLDER = "human_lee_wensing_park2020"
N_BODIES, N_CHANNELS = 16, 3
CHANNELS = ("moment_1", "moment_2", "fz")
# Theirs: m, mx, my, mz, Ixx, Iyy, Izz, Ixy, Iyz, Ixz.
_ORDER = [0, 1, 2, 3, 4, 7, 5, 9, 8, 6]
ALPHAS = (1e1, 1e2, 1e3, 1e4, 1e5)
N_BLOCKS = 5


class Recording:
    """The published rows.

    Attributes:
        matrix: ``(n_rows, 160)`` in pinocchio's order of parameters.
        measured: ``(n_rows,)`` [N·m, N·m, N, …].
        prior: ``(160,)`` anthropometric parameters.
        sigma: ``(3,)`` the authors' weights of the channels' noise, relative.
    """

    def __init__(self, data_dir: Path, folder: Path):
        content = np.load(data_dir / FOLDER / "human_train.npz")
        columns = np.concatenate([10 * body + np.array(_ORDER) for body in range(N_BODIES)])
        self.matrix: Array = content["A"][:, columns]
        self.measured: Array = content["b"]
        self.prior: Array = content["Phi_prior"].T.ravel()[columns]
        self.sigma: Array = content["sigma_diag"]
        self._folder = folder

    @property
    def n_instants(self) -> int:
        """Instants of three rows."""
        return len(self.measured) // N_CHANNELS

    @cached_property
    def robot(self) -> Robot:
        """Sixteen bodies with the prior's parameters, each on a joint of its own."""
        self._folder.mkdir(parents=True, exist_ok=True)
        names = [f"body_{k:02d}" for k in range(N_BODIES)]
        links = "".join(_link(name, ten) for name, ten in zip(names, self.prior.reshape(-1, 10), strict=True))
        file = self._folder / "person.urdf"
        file.write_text(f'<robot name="person"><link name="plate"/>{links}</robot>')
        header = "schema: excite.log/1\nrobot: person.urdf\nbase: fixed\nrate_hz: 1\ntorque: none\n"
        trials = "trials: [{file: rows.csv, role: identification}]\n"
        joints = f"joints: [{', '.join(f'{name}_joint' for name in names)}]\n"
        (self._folder / "log.yaml").write_text(header + joints + trials)
        return robot_for_log(file, self._folder)

    def problem(self, instants: NDArray[np.int64]) -> IdentificationProblem:
        """Rows of some instants; runs of neighbours are trials."""
        rows = (N_CHANNELS * instants[:, None] + np.arange(N_CHANNELS)).ravel()
        run = np.cumsum(np.concatenate([[0], np.diff(instants) > 1]))
        channel = np.tile(np.arange(N_CHANNELS), len(instants))
        names = [f"{segment.link}.{name}" for segment in self.robot.segments for name in PARAMETERS]
        return IdentificationProblem(
            robot=self.robot,
            Y=self.matrix[rows],
            y=self.measured[rows],
            weights=1.0 / self.sigma[channel],
            channel=channel,
            channel_names=CHANNELS,
            channel_units=("N·m", "N·m", "N"),
            time=np.repeat(instants.astype(float), N_CHANNELS),
            trial=np.repeat(run, N_CHANNELS),
            trial_names=tuple(f"run_{k}" for k in range(run[-1] + 1)),
            parameter_names=tuple(names),
            prior=self.prior.copy(),
            n_inertial=len(names),
        )

    def thirds(self, left_out: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Instants to identify from and those of the third (0, 1, 2) that is left out."""
        instants = np.arange(self.n_instants)
        out = np.array_split(instants, 3)[left_out]
        return np.setdiff1d(instants, out), out

    def misses(self, instants: NDArray[np.int64], parameters: Array) -> Array:
        """Root mean square of measured minus predicted of each channel, ``(3,)`` [N·m, N·m, N]."""
        rows = (N_CHANNELS * instants[:, None] + np.arange(N_CHANNELS)).ravel()
        residual = self.measured[rows] - self.matrix[rows] @ parameters
        return np.sqrt(np.mean(residual.reshape(-1, N_CHANNELS) ** 2, axis=0))

    def estimate(self, instants: NDArray[np.int64], method: str, **settings) -> Array:
        """Parameters ``(160,)`` from some instants."""
        chosen = estimator_settings(method, **settings)
        return find_estimator(method).estimate(self.problem(instants), chosen).parameters

    def chosen_alpha(self, instants: NDArray[np.int64], regulariser: str) -> float:
        """Weight of the prior that predicts best by cross-validation in blocks inside the given instants.

        The channels count as the authors weight them.
        """
        scores = []
        for alpha in ALPHAS:
            power = 0.0
            for block in np.array_split(instants, N_BLOCKS):
                rest = np.setdiff1d(instants, block)
                found = self.estimate(rest, "lmi", alpha=alpha, regulariser=regulariser)
                power += len(block) * float(np.sum((self.misses(block, found) / self.sigma) ** 2))
            scores.append(power)
        return ALPHAS[int(np.argmin(scores))]


def _link(name: str, ten: Array) -> str:
    """Link and joint of a body; the inertia moved to its centre of mass."""
    mass, center = ten[0], ten[1:4] / ten[0]
    about = np.array([[ten[4], ten[5], ten[7]], [ten[5], ten[6], ten[8]], [ten[7], ten[8], ten[9]]])
    about = about - mass * ((center @ center) * np.eye(3) - np.outer(center, center))
    moments = dict(zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), about[np.triu_indices(3)], strict=True))
    xyz = " ".join(repr(float(value)) for value in center)
    inertia = " ".join(f'{key}="{float(value)!r}"' for key, value in moments.items())
    return (
        f'<link name="{name}"><inertial><origin xyz="{xyz}" rpy="0 0 0"/><mass value="{float(mass)!r}"/>'
        f'<inertia {inertia}/></inertial></link><joint name="{name}_joint" type="revolute">'
        f'<parent link="plate"/><child link="{name}"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
    )
