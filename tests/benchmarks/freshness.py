"""Whether a measured figure is of today's code: a hash of every module that its benchmark runs through."""

from __future__ import annotations

import ast
import hashlib
import os
import platform
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

from tests.architecture.source_tree import modules, syntax_tree

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Measurement:
    """What a part's figures were measured on.

    Attributes:
        date: day, ISO 8601.
        commit: of the repository, abbreviated; with ``+`` where files were changed since.
        machine: processor, number of cores, Python.
        code: hash of the code that the part runs through; empty where nobody kept it.
        processor_s: that the part took, children included [s]; None where nobody kept it.
    """

    date: str
    commit: str
    machine: str
    code: str
    processor_s: float | None = None

    def sentence(self) -> str:
        """For the page."""
        took = "" if self.processor_s is None else f", in {self.processor_s:.0f} s of a processor"
        return f"Measured {self.date} at {self.commit} on {self.machine}{took}."


def measurement(part: str, seconds: float) -> Measurement:
    """Of a part that was measured just now, in so many seconds of a processor."""
    commit = _git("rev-parse", "--short=8", "HEAD") or "an unknown commit"
    changed = "+" if _git("status", "--porcelain", "--", "excite", "tests/benchmarks") else ""
    machine = f"{_processor()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    date = datetime.now(UTC).date().isoformat()
    return Measurement(date, commit + changed, machine, code_hash(part), round(seconds, 1))


def code_hash(part: str) -> str:
    """Hash of a benchmark and of all modules of the package that it can reach, comments and layout left out."""
    own = ROOT / "tests" / "benchmarks" / f"{part}.py"
    seen: set[str] = set()
    open_ = sorted(_named(own))
    while open_:
        name = open_.pop()
        if name in seen or name not in modules():
            continue
        seen.add(name)
        open_ += [item.module for item in modules()[name].imports if not item.typing]
    digest = hashlib.sha256(_syntax(own).encode())
    for name in sorted(seen):
        digest.update(f"{name}\n{_syntax(modules()[name].path)}".encode())
    return digest.hexdigest()[:16]


def _named(path: Path) -> set[str]:
    """Modules of the package and of the tests' aids that a file imports; commands that it runs reach all of it."""
    text = path.read_text(encoding="utf-8")
    found = {
        node.module
        for node in ast.walk(syntax_tree(path))
        if isinstance(node, ast.ImportFrom) and node.module
    }
    through_commands = {"excite.cli.main"} if '"excite"' in text or '"-m", "excite' in text else set()
    verbs = {name for name in modules() if name.count(".") == 1} if "import excite" in text else set()
    return found | through_commands | verbs


@cache
def _syntax(path: Path) -> str:
    return ast.dump(syntax_tree(path))


def _git(*arguments: str) -> str:
    run = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True)
    return run.stdout.strip() if run.returncode == 0 else ""


def _processor() -> str:
    """The processor's name as the system has it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.machine()
