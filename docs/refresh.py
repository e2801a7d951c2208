"""Bring the README up to date: ``python docs/refresh.py [RESULTS]``.

Runs the README's Python block and writes what it prints below it. With the folder of a finished demo or
campaign (``out/demo``), draws the README's pictures from it too.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from excite.atomic import atomic_path, write_text
from excite.report.folder import read_folder
from excite.report.plots.postures import choose_motions, draw_snapshots
from excite.report.sections.identified import draw_masses
from excite.report.theme import to_png

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"


def fill(text: str, marker: str, content: str) -> str:
    """Replace what stands between ``<!-- marker -->`` and ``<!-- /marker -->``."""
    start, end = f"<!-- {marker} -->\n", f"<!-- /{marker} -->"
    head, rest = text.split(start, 1)
    return head + start + content.rstrip("\n") + "\n" + end + rest.split(end, 1)[1]


def printed_by_the_first_block(readme: str) -> str:
    """What the README's first Python block prints, run in an empty folder."""
    found = re.search(r"```python\n(.*?)```", readme, flags=re.DOTALL)
    if found is None:
        raise SystemExit("README.md has no Python block")
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.run(
            [sys.executable, "-c", found[1]], cwd=folder, capture_output=True, text=True, check=True
        )
    return run.stdout


def draw_pictures(results: Path) -> None:
    """Write the README's pictures from a results folder."""
    findings = read_folder(results)
    if findings.robot is None or findings.data.masses is None:
        raise SystemExit(f"{results} holds no motions or no masses")
    pictures = {
        "motions.png": to_png(draw_snapshots(findings.robot, choose_motions(findings.motions, 3)), dpi=130),
        "masses.png": to_png(draw_masses(findings.data.masses), dpi=130),
    }
    for name, content in pictures.items():
        with atomic_path(IMAGES / name) as temporary:
            temporary.write_bytes(content)


def main() -> None:
    """Refresh the README."""
    path = ROOT / "README.md"
    readme = path.read_text(encoding="utf-8")
    printed = printed_by_the_first_block(readme)
    write_text(path, fill(readme, "result", f"```text\n{printed}```"))
    for results in sys.argv[1:]:
        draw_pictures(Path(results))


if __name__ == "__main__":
    main()
