"""The manual builds without a warning: no link leads nowhere, no page is left out, no docstring is malformed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.manual.pages import DOCS

ROOT = DOCS.parent


def build(source: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """Build as `make manual` does."""
    options = ["-W", "--keep-going", "-q", "-b", "html", "-d", str(out / ".doctrees")]
    return subprocess.run(
        [sys.executable, "-m", "sphinx", *options, str(source), str(out)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    done = build(DOCS, tmp_path)
    assert done.returncode == 0, done.stderr
    commands = (tmp_path / "reference" / "generated" / "commands.html").read_text(encoding="utf-8")
    assert "excite identify-load" in commands and "Examples:" in commands
    names = (tmp_path / "reference" / "generated" / "names.html").read_text(encoding="utf-8")
    assert "load_dependent_friction" in names and "ur-script" in names
    python = (tmp_path / "reference" / "api.html").read_text(encoding="utf-8")
    assert 'id="excite.methods.write_ranges"' in python
    findings = (tmp_path / "reference" / "findings.html").read_text(encoding="utf-8")
    assert 'id="term-weak_torque"' in findings
    notebook = (tmp_path / "tutorials" / "generated" / "arm_to_simulator.html").read_text(encoding="utf-8")
    assert "<th>segment</th>" in notebook and "upper_arm_link" in notebook
    drawn = (tmp_path / "tutorials" / "generated" / "excitation_quality.html").read_text(encoding="utf-8")
    assert drawn.count('src="../../_images/') >= 5


@pytest.mark.slow
def test_a_link_that_leads_nowhere_fails(tmp_path: Path) -> None:
    source = tmp_path / "docs"
    source.mkdir()
    settings = (DOCS / "conf.py").read_text(encoding="utf-8").replace('    "generated_pages",\n', "")
    (source / "conf.py").write_text(settings, encoding="utf-8")
    (source / "index.md").write_text("# One page\n\n[here](nowhere.md)\n", encoding="utf-8")
    done = build(source, tmp_path / "out")
    assert done.returncode == 1 and "nowhere.md" in done.stderr


def test_makefile_and_test_build_alike() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert "-m sphinx -W --keep-going -q -b html" in makefile
