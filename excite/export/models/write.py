"""All files of an identified model, as a command leaves them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from excite.atomic import atomic_path
from excite.display import count
from excite.errors import InputError
from excite.export.models.mjcf import write_mjcf
from excite.export.models.parameters import InconsistentModelError, find_differences
from excite.export.models.urdf import write_urdf
from excite.export.models.verification import WrittenModel
from excite.identification.result import Identification
from excite.robot.load import RobotLike, as_robot


@dataclass(frozen=True)
class ModelFiles:
    """The files of an identified model.

    Attributes:
        differences: the table nominal → identified.
        urdf: ``identified.urdf``; None where it was refused.
        mjcf: ``identified.xml``; None where it was refused.
        refused: why models were refused, one sentence each.
        uncertainty: ``uncertainty.npz``, the parameters with their covariance, which ``uncertainty.identified`` of a
            robot.yaml names; None where it was not computed.
    """

    differences: Path
    urdf: WrittenModel | None
    mjcf: WrittenModel | None
    refused: tuple[str, ...]
    uncertainty: Path | None = None

    def to_json(self) -> dict[str, Any]:
        """The block ``models`` of the command's document."""
        return {
            "differences": self.differences.name,
            "urdf": None if self.urdf is None else self.urdf.to_json(),
            "mjcf": None if self.mjcf is None else self.mjcf.to_json(),
            "refused": list(self.refused),
            "uncertainty": None if self.uncertainty is None else self.uncertainty.name,
        }

    def summary(self) -> str:
        """What was written and what was not, a line each."""
        lines = []
        for model in (self.urdf, self.mjcf):
            if model is not None:
                lines.append(
                    f"wrote {model.path.name}: parameters of {count(len(model.changed), 'link')} as identified"
                )
                lines += [f"  {note}" for note in model.notes]
        lines.append(f"wrote {self.differences.name}")
        if self.uncertainty is not None:
            lines.append(
                f"wrote {self.uncertainty.name}: named under uncertainty.identified of robot.yaml, it is what "
                "`excite check` and `plan --robust` keep their margins for"
            )
        return "\n".join([*lines, *(f"not written: {reason}" for reason in self.refused)])


def write_models(
    robot: RobotLike,
    identification: Identification,
    folder: Path,
    *,
    drives: bool = False,
    force: bool = False,
    template: Path | None = None,
) -> ModelFiles:
    """Write ``identified.urdf``, ``identified.xml`` (MJCF), ``differences.csv`` and ``uncertainty.npz`` into a folder.

    Models that no rigid body matches, and those of torques in an unknown unit, are refused, and a file of an earlier
    run under their name removed; the table is written in any case.

    Args:
        robot: the robot that was identified, or its name or file.
        identification: what was identified.
        folder: folder to write to.
        drives: also write the identified friction.
        force: write the URDF of physically inconsistent parameters, too (MuJoCo takes none).
        template: a MuJoCo model of the robot whose text is kept but for its inertials; None makes a plain one.

    Returns:
        The files, and what of the robot changed in them.

    Raises:
        InputError: the identification is of another robot.
    """
    robot, folder = as_robot(robot), Path(folder)
    rows = find_differences(identification.to_json()["standard_parameters"])
    differences = rows.save(folder / "differences.csv")
    refused: list[str] = []
    urdf, mjcf = folder / "identified.urdf", folder / "identified.xml"

    def attempt(path: Path, write: Callable[..., WrittenModel], **options: Any) -> WrittenModel | None:
        try:
            return write(robot, identification, path, drives=drives, **options)
        except InconsistentModelError as error:
            path.unlink(missing_ok=True)
            refused.append(f"{path.name}: {error.what}; {error.remedy}")
        except InputError as error:
            path.unlink(missing_ok=True)
            refused.append(f"{path.name}: {error}")
        return None

    if identification.in_unknown_unit and not force:
        for path in (urdf, mjcf):
            path.unlink(missing_ok=True)
        said = "no model: the torques are in an unknown unit, and so would be its weight"
        return ModelFiles(differences, None, None, (f"{said}; state the unit and identify again",))
    return ModelFiles(
        differences,
        attempt(urdf, write_urdf, force=force),
        attempt(mjcf, write_mjcf, template=template),
        tuple(refused),
        _write_uncertainty(identification, folder / "uncertainty.npz"),
    )


def _write_uncertainty(identification: Identification, path: Path) -> Path | None:
    """Links, inertial parameters and their covariance; None, and no file, where there is none."""
    known, n = identification.uncertainty, len(identification.parameters)
    if known is None or known.covariance is None:
        path.unlink(missing_ok=True)
        return None
    arrays: dict[str, Any] = {
        "links": np.array(identification.links),
        "parameters": identification.parameters,
        "covariance": known.covariance[:n, :n],
    }
    with atomic_path(path) as temporary:
        np.savez_compressed(temporary, **arrays)
    return path
