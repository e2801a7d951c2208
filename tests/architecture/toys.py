"""A toy member of every axis: its file, its lines in the registries, and what users then see of it.

Run in a copy of the package that has the toys (``PYTHONPATH``), it prints one JSON object: by axis, what was seen.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Toy:
    """A member that nobody needs.

    Attributes:
        file: its file, below the package.
        text: what stands in it.
        lines: by file of the package, lines to put in, each before the first line that begins with the text given.
        axis: where it is installed as a package of somebody else's, by an entry point; ``file`` is a module of that.
    """

    file: str
    text: str
    lines: tuple[tuple[str, str, str], ...] = ()
    axis: str = ""


def registered(
    registry: str, module: str, name: str, entry: str, end: str
) -> tuple[tuple[str, str, str], ...]:
    """Two lines of a registry that imports its members: the import, and the entry."""
    return (
        (registry, "from excite.", f"from excite.{module} import {name}"),
        (registry, end, f"        {entry},"),
    )


TOYS = {
    "generator": Toy(
        "motion/generators/toy.py",
        """
from dataclasses import replace

from excite.motion.generators.generator import Generator
from excite.motion.generators.joint_motions import RandomJoint


class Toy(Generator):
    name = "toy"
    summary = "random joints by another name"

    def applies(self, robot):
        return RandomJoint().applies(robot)

    def aims(self, robot):
        return RandomJoint().aims(robot)

    def draw(self, robot, seed, targets, name):
        return replace(RandomJoint().draw(robot, seed, targets, name), generator=self.name)
""",
        (
            (
                "motion/generators/registry.py",
                '        "random_joint": ',
                '        "toy": "excite.motion.generators.toy:Toy",',
            ),
        ),
    ),
    "search": Toy(
        "campaign/toy_search.py",
        """
import numpy as np

from excite.campaign.optimised_series import CandidateSearch
from excite.motion.generators.joint_motions import RandomJoint


class ToySearch(CandidateSearch):
    name = "toy_search"

    def candidates(self, asked, seed):
        return RandomJoint().candidates(asked.robot, asked.count, np.random.SeedSequence(seed))
""",
        (
            (
                "campaign/searches.py",
                '        "optimised_fourier": ',
                '        "toy_search": "excite.campaign.toy_search:ToySearch",',
            ),
        ),
    ),
    "check": Toy(
        "toy_check.py",
        """
from excite.safety.checks.base import Check, CheckResult
from excite.safety.verdict import Violation


class Toy(Check):
    name = "toy"

    def judge(self, sweep):
        if sweep.motion.name != "disliked":
            return CheckResult()
        return CheckResult(violations=(Violation("toy", 0.0, "anywhere", 1.0, 0.0),))
""",
        axis="checks",
    ),
    "repair": Toy(
        "safety/repairs/toy.py",
        """
from excite.safety.repairs.draft import Repair


class ToyRepair(Repair):
    name = "toy"

    def repair(self, draft):
        return draft.rejected("toy", "anywhere") if draft.candidate.name.endswith("_001") else draft
""",
        registered("safety/filter.py", "safety.repairs.toy", "ToyRepair", "ToyRepair", "        Sampling,"),
    ),
    "estimator": Toy(
        "identification/estimators/toy.py",
        """
from dataclasses import replace

from excite.identification.estimators.estimator import Estimator
from excite.identification.estimators.least_squares import WlsSettings
from excite.identification.estimators.registry import find_estimator


class ToyEstimator(Estimator[WlsSettings]):
    name = "toy"
    title = "weighted least squares by another name"
    use = "tests"
    settings_class = WlsSettings

    def solve(self, rows, settings):
        return replace(find_estimator("wls").solve(rows, settings), method=self.name)
""",
        (
            (
                "identification/estimators/registry.py",
                '        "physical": ',
                '        "toy": "excite.identification.estimators.toy:ToyEstimator",',
            ),
        ),
    ),
    "injected effect": Toy(
        "simulation/effects/toy.py",
        """
from excite.simulation.effects.laws import SpringLaw

ToyLaw = SpringLaw
""",
        registered(
            "simulation/effects/registry.py",
            "simulation.effects.toy",
            "ToyLaw",
            '_E("toy", "a spring", "N·m/rad", 0.0, 100.0, _all_joints, _constant_value(5.0),'
            " lambda v, name, x: v.with_law(ToyLaw(v.robot.joint_index(name), x)))",
            "    # readings",
        ),
    ),
    "diagnosed effect": Toy(
        "toy_effect.py",
        '''
from excite.diagnosis.effects.effect import Effect, Parameter, Shape


class Toy(Effect):
    """``τ = c q v``: damping that grows with the position."""

    name = "toy"
    linear = (Parameter("coefficient", "N·m·s/rad²"),)
    confusable_with = ("viscous_friction",)
    separating_motion = "the joint to and fro at one end of its range"

    def shape(self, context, location, theta):
        j = context.row(location)
        return Shape({j: (context.q[:, j] * context.v[:, j])[:, None]})
''',
        # A word of the log format: only for logs that say that their model has it.
        (("logs/vocabulary.py", '    "viscous_friction",', '    "toy",'),),
        axis="effects",
    ),
    "format": Toy(
        "formats/toy.py",
        """
import json

import numpy as np

from excite.formats.format import ColumnFormat, Content


class ToyFormat(ColumnFormat):
    name = "toy"
    suffixes = (".toy",)

    def _read(self, path):
        return Content({name: np.array(values) for name, values in json.loads(path.read_text()).items()})

    def write(self, columns, path, statement=""):
        path.write_text(json.dumps({name: values.tolist() for name, values in columns.items()}))
""",
        (("formats/registry.py", '        "csv": ', '        "toy": "excite.formats.toy:ToyFormat",'),),
    ),
    "motion reader": Toy(
        "motion/readers/toy.py",
        """
import json

import numpy as np

from excite.motion.readers.reader import MotionReader, RawMotion


class ToyReader(MotionReader):
    name = "toy"
    summary = "JSON by another name (.toymotion)"

    def recognises(self, path):
        return path.suffix == ".toymotion"

    def read(self, path, joints):
        return RawMotion({name: np.array(values) for name, values in json.loads(path.read_text()).items()})
""",
        (
            (
                "motion/readers/registry.py",
                "from excite.motion.readers.",
                "from excite.motion.readers.toy import ToyReader",
            ),
            ("motion/readers/registry.py", "    )", "        ToyReader,"),
        ),
    ),
    "exporter": Toy(
        "toy_exporter.py",
        """
from excite.atomic import write_text
from excite.export.exporter import Exporter


class Toy(Exporter):
    name = "toy"
    suffix = ".txt"
    summary = "the number of samples"

    def write(self, motion, path):
        write_text(path, f"{motion.n_samples} samples")
""",
        axis="exporters",
    ),
    "reader": Toy(
        "toy_reader.py",
        """
import numpy as np

from excite.conversion.recording import Column, Recording, Stream
from excite.conversion.sources.source import Source


class Toy(Source):
    name = "toy"
    summary = "numbers of one axis by another name (.txt)"

    def recognises(self, path):
        return path.name == "toy.txt"

    def read(self, path):
        time, q, tau = np.array(path.read_text().split(), dtype=float).reshape(3, -1)
        columns = (Column("q", q, channel="q"), Column("tau", tau, channel="tau"))
        return (Recording(str(path), "toy", (Stream("toy", columns, time),)),)
""",
        axis="readers",
    ),
    "report section": Toy(
        "report/sections/toy.py",
        """
def show_toy(findings):
    return ["Nobody needs it."]
""",
        (
            ("report/page.py", "from excite.", "from excite.report.sections.toy import show_toy"),
            ("report/page.py", '    ("sessions", ', '    ("toy", "A toy", show_toy),'),
        ),
    ),
}


def touched_files() -> set[str]:
    """Files below the package that the toys add or change."""
    changed = {name for toy in TOYS.values() for name, _, _ in toy.lines}
    return changed | {toy.file for toy in TOYS.values() if not toy.axis}


def add_toys(package: Path) -> None:
    """Write the files of all toys into a copy of the package, and their lines into its registries."""
    for toy in TOYS.values():
        file = (package.parent if toy.axis else package) / toy.file
        if file.exists():
            raise FileExistsError(file)
        file.write_text(toy.text)
        for name, before, line in toy.lines:
            if not (package / name).resolve().is_relative_to(package.resolve()):
                raise FileExistsError(f"{name} lies behind a link, in the package itself")
            rows = (package / name).read_text().splitlines()
            place = min(i for i, row in enumerate(rows) if row.startswith(before))
            rows.insert(place, line)
            (package / name).write_text("\n".join(rows) + "\n")
    about = package.parent / "toys-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n")
    outside = [toy for toy in TOYS.values() if toy.axis]
    points = [f"[excite.{toy.axis}]\ntoy = {Path(toy.file).stem}:Toy\n" for toy in outside]
    (about / "entry_points.txt").write_text("\n".join(points))


def planned(folder: Path) -> dict[str, Any]:
    """A plan of each of the toys that make candidates, with the toy's repair and check among the others."""
    import excite

    robot = excite.load_robot("ur10")
    drawn = excite.plan(robot, n_candidates=2, generator="toy", seed=1)
    searched = excite.plan(robot, n_candidates=1, generator="toy_search", seed=1)
    drawn.save(folder / "plan")
    motion = next(iter(drawn.accepted))
    verdict = excite.check(robot, [motion.renamed("disliked")])
    return {
        "generator": {
            "known": _known(lambda: excite.plan(robot, generator="?")),
            "by": motion.metadata.generator,
        },
        "search": {"accepted": len(searched.accepted)},
        "repair": drawn.to_json()["candidates"]["rejected"],
        "check": [[violation.kind for violation in item.violations] for item in verdict.verdicts],
        "report section": "Nobody needs it." in excite.report(folder / "plan").read_text(),
    } | _moved(robot, motion, folder)


def _moved(robot: Any, motion: Any, folder: Path) -> dict[str, Any]:
    """The motion written and read, run with the toy's effect, and what the log of that tells."""
    import excite
    from excite.motion.content import motion_columns

    text = excite.export_motion(motion, robot, "toy", folder / "exported.txt").read_text()
    file = folder / "motion.toymotion"
    file.write_text(json.dumps({name: column.tolist() for name, column in motion_columns(motion).items()}))
    read = excite.load_motion(file, robot)
    shutil.copy(file, folder / "motion.toy")
    by_format = excite.load_motion(folder / "motion.toy", robot)
    short = excite.simulate(robot, [motion], seed=0, nominal=True).log
    other = excite.simulate(robot, [motion], inject=("toy:elbow_joint:20",), seed=0, nominal=True).log
    entry = short.header.trials[0].model_copy(update={"file": "trial.toy"})
    log = replace(short, header=short.header.model_copy(update={"trials": (entry,)}))
    again = excite.load_log(excite.save_log(log, folder / "log"), robot)
    (folder / "log" / "log.yaml").write_text(
        (folder / "log" / "log.yaml").read_text().replace("trial.toy", "trial.strange")
    )
    return {
        "exporter": {"text": text, "known": _known(lambda: excite.export_motion(motion, robot, "?", file))},
        "motion reader": {
            "same": bool((read.q == motion.q).all()),
            "remedy": _remedy(lambda: excite.load_motion(folder / "log" / "log.yaml", robot)),
        },
        "injected effect": {
            "changed": float(abs(other.trials[0].tau - short.trials[0].tau).max()),
            "known": _known(lambda: excite.simulate(robot, [motion], inject=("?",))),
        },
        "format": {
            "log": bool((again.trials[0].tau == short.trials[0].tau).all()),
            "motion": bool((by_format.q == motion.q).all()),
            "remedy": _remedy(lambda: excite.load_log(folder / "log", robot)),
        },
        "estimator": {
            "method": excite.identify(robot, short, "toy").to_json()["method"],
            "known": _known(lambda: excite.identify(robot, short, "?")),
        },
    }


def converted(folder: Path) -> dict[str, Any]:
    """A recording that no format of the package recognises as what it is."""
    import numpy as np

    import excite
    from tests.diagnosis.test_one_joint import URDF

    (folder / "axis.urdf").write_text(URDF)
    time = np.arange(0.0, 6.0, 0.01)
    q = 0.5 * np.sin(3.0 * time)
    np.savetxt(folder / "toy.txt", [time, q, 40.0 * np.gradient(q, time)])
    excite.convert([folder / "toy.txt"], folder / "axis.urdf", folder / "toy_log")
    return {"reader": float(abs(excite.load_log(folder / "toy_log").trials[0].q).max())}


def diagnosed(folder: Path) -> dict[str, Any]:
    """An axis with the toy's damping, diagnosed; and once more with a model that is said to have it."""
    import numpy as np

    import excite
    from tests.diagnosis.test_one_joint import RATE_HZ, URDF, axis_header, pushed

    rng = np.random.default_rng(0)
    trials = []
    for name, role, seconds, phase in (("a", "identification", 12.0, 0.3), ("b", "validation", 5.0, 1.1)):
        trial = pushed(name, role, seconds, phase, rng)
        speed = np.gradient(trial.q[:, 0], trial.time)
        trials.append(replace(trial, tau=trial.tau + 1500.0 * trial.q * speed[:, None]))
    modelled = ("rigid_body", "viscous_friction", "coulomb_friction", "torque_bias")
    log = excite.Log(axis_header(RATE_HZ, modelled, ("a", "b")), tuple(trials), robot_text=URDF)
    found = excite.diagnose(excite.save_log(log, folder / "damped"))
    header = axis_header(RATE_HZ, (*modelled, "toy"), ("a", "b"))
    excite.save_log(replace(log, header=header), folder / "modelled")
    return {
        "diagnosed effect": {
            "verdict": found.verdict,
            "effect": found.effect,
            "warnings": [] if found.simulation is None else list(found.simulation.warnings),
            "listed": [item.law for item in excite.effect_summaries() if item.name == "toy"],
            "modelled": excite.load_log(folder / "modelled").header.modelled[-1],
        }
    }


def _known(call: Callable[[], object]) -> list[str]:
    from excite.errors import UnknownNameError

    try:
        call()
    except UnknownNameError as error:
        return list(error.known)
    return []


def _remedy(call: Callable[[], object]) -> str:
    from excite.errors import InputError

    try:
        call()
    except InputError as error:
        return error.remedy
    return ""


if __name__ == "__main__":
    place = Path(sys.argv[1])
    print(json.dumps(planned(place) | converted(place) | diagnosed(place)))
