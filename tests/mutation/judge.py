"""Does a test fail when a mutant takes a file's place? Judged in a copy of the project by the tests that reach it."""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from tests.mutation.mutants import Mutant

# Seconds of tests that a mutant is given, the fastest first; and its time-out: that and the interpreter's start, with
# room for a slower machine and for kernels that are compiled anew.
BUDGET_S = 100.0
_SLOWER, _START_S = 3.0, 30.0


@dataclass(frozen=True)
class Judgement:
    """What became of a mutant: ``killed``, ``timeout`` (which counts as killed), ``survived`` or ``unreached``."""

    outcome: str
    n_tests: int
    seconds: float

    @property
    def killed(self) -> bool:
        """Whether the tests noticed it."""
        return self.outcome in {"killed", "timeout"}


@dataclass(frozen=True)
class Reach:
    """Which tests enter which functions.

    Attributes:
        seconds: that each test takes.
        functions: that each test enters, as (path, first line).
    """

    seconds: dict[str, float]
    functions: dict[str, set[tuple[str, int]]]

    def tests(self, mutant: Mutant, root: Path) -> list[str]:
        """Tests that a mutant is given: those that enter the function that it changes, the fastest first.

        Where no test is seen to enter it (compiled code, a line outside functions), those that enter its file, and
        where there are none (a file of constants) all; and for a line outside functions those that enter none, which
        look at what is defined. The other tests of the same files follow, those with the same
        parameters before the rest: they may look at what an earlier one has made and kept.
        """
        first = _function_around((root / mutant.path).read_text(encoding="utf-8"), mutant.line)
        function = (mutant.path, first)
        direct = {test for test, entered in self.functions.items() if function in entered}
        if not direct:
            entered_by = self.functions.items()
            direct = {test for test, entered in entered_by if any(path == mutant.path for path, _ in entered)}
        direct = direct or set(self.functions)
        if first == 0:
            direct |= {test for test, entered in self.functions.items() if not entered}
        files = {_file(test) for test in direct}
        parameters = {_parameters(test) for test in direct}

        def order(test: str) -> tuple[bool, bool, float]:
            return test not in direct, _parameters(test) not in parameters, self.seconds[test]

        chosen, total = [], 0.0
        for test in sorted((test for test in self.functions if _file(test) in files), key=order):
            total += self.seconds[test]
            if chosen and total > BUDGET_S:
                break
            chosen.append(test)
        # Tests of a file stay together: its fixtures are made once.
        turn = list(dict.fromkeys(map(_file, chosen)))
        return sorted(chosen, key=lambda test: turn.index(_file(test)))


def _file(test: str) -> str:
    return test.split("::")[0]


def _parameters(test: str) -> str:
    return test.partition("[")[2]


def _function_around(source: str, line: int) -> int:
    """First line of the innermost function around a line, decorators included; 0 if it is in none."""
    innermost = 0
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            if first <= line <= (node.end_lineno or first):
                innermost = max(innermost, first)
    return innermost


@dataclass(frozen=True)
class Bench:
    """A copy of the project in which files are changed.

    Attributes:
        root: of the copy.
        python: interpreter that runs the tests.
        data: folder of recordings that tests read.
    """

    root: Path
    python: Path
    data: Path

    @classmethod
    def make(cls, project: Path, folder: Path, python: Path) -> Bench:
        """Copy the files that git tracks or would track."""
        command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        listed = subprocess.run(command, cwd=project, capture_output=True, text=True, check=True).stdout
        for name in filter(None, listed.split("\0")):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(project / name, folder / name)
        return cls(folder, python, Path(os.environ.get("EXCITE_DATA", project.parent / "shared" / "data")))

    def reach(self, tests: list[str]) -> Reach:
        """Run tests unchanged and see what they enter.

        Raises:
            RuntimeError: a test fails without any mutant.
        """
        found = self.root / "touched.json"
        run = self._pytest(["-p", "tests.mutation.touched", "--touched", str(found), *tests], None)
        if run.returncode != 0:
            raise RuntimeError(f"tests fail without a mutant:\n{run.stdout[-3000:]}")
        content = json.loads(found.read_text(encoding="utf-8"))
        return Reach(
            {test: entry["seconds"] for test, entry in content.items()},
            {test: {(path, line) for path, line in entry["functions"]} for test, entry in content.items()},
        )

    def judge(self, mutant: Mutant, reach: Reach) -> Judgement:
        """Put a mutant in its file's place, run the tests that reach it, and put the file back."""
        tests = reach.tests(mutant, self.root)
        if not tests:
            return Judgement("unreached", 0, 0.0)
        path = self.root / mutant.path
        original = path.read_bytes()
        # Compiled files are known by their second and their size, which a mutant may share with the original.
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            compiled.unlink()
        path.write_text(mutant.code(self.root), encoding="utf-8")
        arguments = self.root / "arguments.txt"
        arguments.write_text("\n".join(tests), encoding="utf-8")
        limit = _START_S + _SLOWER * sum(reach.seconds[test] for test in tests)
        start = time.monotonic()
        try:
            code = self._pytest([f"@{arguments}"], limit).returncode
            outcome = "survived" if code == 0 else "killed"
        except subprocess.TimeoutExpired:
            outcome = "timeout"
        finally:
            path.write_bytes(original)
        return Judgement(outcome, len(tests), time.monotonic() - start)

    def _pytest(self, arguments: list[str], limit: float | None) -> subprocess.CompletedProcess:
        command = [str(self.python), "-m", "pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider"]
        environment = {
            **os.environ,
            "PYTHONPATH": str(self.root),
            "PYTHONDONTWRITEBYTECODE": "1",
            # Plugins that these tests do not use take as long to load as many of the tests to run.
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            "EXCITE_DATA": str(self.data),
        }
        return subprocess.run(
            [*command, *arguments],
            cwd=self.root,
            env=environment,
            capture_output=True,
            text=True,
            timeout=limit,
            check=False,
        )
