"""What the package is made of and comes with: pins, licences, the wheel, how it is cited."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import excite
from tests.supply.licences import Licence
from tests.supply.needed import needed, needed_names, stated

ROOT = Path(__file__).resolve().parents[1]
PROJECT_FILE = ROOT / "pyproject.toml"
PROJECT = tomllib.loads(PROJECT_FILE.read_text(encoding="utf-8"))["project"]
PYTHONS = re.findall(r"Programming Language :: Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))


def _pins(**environment: str) -> dict[str, Requirement]:
    """Lines of constraints.txt that hold for this interpreter, or with other values of markers, by normalised name."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [Requirement(line) for line in lines if line and not line.startswith("#")]
    here = [pin for pin in pins if pin.marker is None or pin.marker.evaluate(environment)]
    names = [canonicalize_name(pin.name) for pin in here]
    assert len(set(names)) == len(names), "a package is pinned twice"
    return dict(zip(names, here, strict=True))


@pytest.mark.parametrize("python", PYTHONS)
def test_whatever_gets_installed_is_pinned_on_every_python(python):
    environment = {"python_version": python, "python_full_version": f"{python}.0"}
    assert needed_names(stated(PROJECT_FILE), environment) <= set(_pins(**environment))


def test_installed_versions_are_the_pinned_ones():
    installed = needed(stated(PROJECT_FILE))
    pins = _pins()
    found = {name: one.version for name, one in installed.items()}
    assert found == {name: str(pins[name].specifier).removeprefix("==") for name in found}
    assert set(pins) == set(found), "pinned and no longer needed"


def test_pins_are_versions_and_not_addresses():
    for pin in _pins().values():
        assert pin.url is None
        assert [one.operator for one in pin.specifier] == ["=="]


def test_pins_are_within_what_the_project_allows():
    pins = _pins()
    for line in stated(PROJECT_FILE):
        asked = Requirement(line)
        (pin,) = pins[canonicalize_name(asked.name)].specifier
        assert asked.specifier.contains(pin.version), line


def test_what_extras_need_goes_together_with_the_pins():
    """`pip install -c constraints.txt '.[viz]'` finds versions: the extras that are installed here allow the pins."""
    pins, looked_at = _pins(), set()
    for line in (line for lines in PROJECT["optional-dependencies"].values() for line in lines):
        name = canonicalize_name(Requirement(line).name)
        try:
            asked = [Requirement(text) for text in metadata.distribution(name).requires or ()]
        except metadata.PackageNotFoundError:
            continue
        for one in asked:
            pin = pins.get(canonicalize_name(one.name))
            if pin is None or (one.marker is not None and not one.marker.evaluate({"extra": ""})):
                continue
            (version,) = pin.specifier
            assert one.specifier.contains(version.version), f"{name} needs {one}, {version} is pinned"
            looked_at.add(name)
    assert len(looked_at) > 5


def test_supported_pythons_are_those_that_the_project_accepts():
    accepted = Requirement(f"python{PROJECT['requires-python']}").specifier
    assert PYTHONS == [f"3.{minor}" for minor in range(8, 20) if accepted.contains(f"3.{minor}.0")]


def _licences(project: Path, **environment: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "tests.supply", str(project)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        env={"PYTHONPATH": environment.get("path", ""), "PATH": ""},
    )


def test_every_licence_is_listed():
    run = _licences(PROJECT_FILE)
    assert run.returncode == 0, run.stderr
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in run.stdout.splitlines()[2:]]
    assert {row[0]: row[1] for row in rows} == {
        name: found.version for name, found in needed(stated(PROJECT_FILE)).items()
    }
    assert all(row[2] for row in rows)
    copyleft = {row[0]: row[3] for row in rows}
    assert (copyleft["docutils"], copyleft["eiquadprog"], copyleft["hypothesis"]) == (
        "strong",
        "weak",
        "weak",
    )
    assert copyleft["numpy"] == copyleft["mujoco"] == copyleft["packaging"] == ""
    used_for = {row[0]: row[4] for row in rows}
    assert [name for name in copyleft if copyleft[name] == "strong" and used_for[name] == "run"] == []
    assert (used_for["llvmlite"], used_for["pluggy"]) == ("run", "test")


def test_a_licence_that_nothing_states_is_named_and_fails(tmp_path):
    for name, said in (("silent", ""), ("speaking", "License: MIT\n")):
        folder = tmp_path / f"{name}-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n{said}")
    project = tmp_path / "pyproject.toml"
    project.write_text('[project]\nname = "x"\ndependencies = ["silent", "speaking"]\n')
    run = _licences(project, path=str(tmp_path))
    assert run.returncode == 1
    assert "silent 1.0" in run.stderr and "speaking" not in run.stderr
    assert "NOT KNOWN" in run.stdout


@pytest.mark.parametrize(
    ("licence", "copyleft"),
    [
        ("GPL-3.0-only", "strong"),
        ("AGPL-3.0-or-later", "strong"),
        ("GNU General Public License v2 or later (GPLv2+)", "strong"),
        ("LGPL-3.0-or-later", "weak"),
        ("GNU Lesser General Public License v3 (LGPLv3)", "weak"),
        ("MPL-2.0", "weak"),
        ("BSD-3-Clause", ""),
        ("Apache-2.0 WITH LLVM-exception", ""),
    ],
)
def test_copyleft_is_recognised(licence, copyleft):
    assert Licence("x", "1", licence).copyleft == copyleft


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> zipfile.ZipFile:
    """The wheel that `pip install` builds, made with the build backend that is installed."""
    folder = tmp_path_factory.mktemp("wheel")
    run = subprocess.run(
        [
            *(sys.executable, "-m", "pip", "wheel", str(ROOT), "--wheel-dir", str(folder)),
            *("--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check"),
        ],
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    (path,) = folder.glob("*.whl")
    return zipfile.ZipFile(path)


def test_the_wheel_holds_code_types_robots_motions_and_licence(wheel):
    names = set(wheel.namelist())
    assert "excite/py.typed" in names
    for folder, inside in (
        ("robots", "excite/data/robots"),
        ("motion_library", "excite/data/motion_library"),
        ("excite", "excite"),
    ):
        paths = [path.relative_to(ROOT / folder) for path in (ROOT / folder).rglob("*") if path.is_file()]
        there = {f"{inside}/{path.as_posix()}" for path in paths if "__pycache__" not in path.parts}
        assert there and there <= names
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)
    assert not any(name.startswith(("tests/", "notebooks/", "docs/")) for name in names)


def test_the_wheel_says_its_version_and_its_licence(wheel):
    (name,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    metadata = wheel.read(name).decode()
    assert f"\nVersion: {PROJECT['version']}\n" in metadata
    assert f"\nLicense-Expression: {PROJECT['license']}\n" in metadata
    assert "\nClassifier: Typing :: Typed\n" in metadata


def test_one_version_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert excite.__version__ == PROJECT["version"] == citation["version"]


def test_the_citation_is_complete():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert (citation["title"], citation["license"]) == (PROJECT["name"], PROJECT["license"])
    assert citation["authors"] == [{"name": author["name"]} for author in PROJECT["authors"]]
    assert [reference["year"] for reference in citation["references"]] == [2015, 2016]
    for reference in citation["references"]:
        assert {"type", "title", "authors"} <= set(reference)
    assert f"https://doi.org/{citation['references'][1]['doi']}" in PROJECT["urls"].values()


def test_extras_have_the_names_that_are_promised() -> None:
    extras = PROJECT["optional-dependencies"]
    assert {"ros", "viz", "cluster", "biomech", "docs", "pandas", "hdf5", "mcap"} <= set(extras)
    # An older name stays, and means what the new one does.
    assert extras["mcap"] == ["excite[ros]"]
    asked = set(
        re.findall(r"excite\[(\w+)\]", "".join(p.read_text() for p in (ROOT / "excite").rglob("*.py")))
    )
    assert asked and asked <= set(extras)


def test_the_source_distribution_builds_a_package_that_has_its_data(tmp_path: Path) -> None:
    """From the archive alone, as somebody would who got it from an index: unpacked, and a wheel made of that."""
    build = "import sys, hatchling.build as b; print(getattr(b, sys.argv[1])(sys.argv[2]))"

    def built(kind: str, folder: Path) -> Path:
        done = subprocess.run(
            [sys.executable, "-c", build, kind, str(tmp_path)],
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
        )
        return tmp_path / done.stdout.strip()

    with tarfile.open(built("build_sdist", ROOT)) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
        archive.extractall(tmp_path, filter="data")
    assert {
        "LICENSE",
        "README.md",
        "CHANGELOG.md",
        "pyproject.toml",
        "excite/__init__.py",
        "tests/test_supply.py",
    } <= names
    assert not [
        name for name in names if "__pycache__" in name or name.startswith(("out/", ".venv", "shared"))
    ]
    wheel = built("build_wheel", tmp_path / f"excite-{excite.__version__}")
    with zipfile.ZipFile(wheel) as archive:
        held = archive.namelist()
    assert "excite/data/robots/ur10/robot.yaml" in held and any(
        n.startswith("excite/data/motion_library/") for n in held
    )
    assert all(name.startswith(("excite/", "excite-")) for name in held)
