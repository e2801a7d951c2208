"""Pages in a browser: no word on the console, no request, nothing cut off, and the robot where pinocchio has it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import excite
from excite.motion.files import load_motion
from excite.report.page import report
from excite.report.replay.tracks import FRAMES_HZ
from excite.robot.loading import load_robot
from tests.report.chromium import PROGRAM, Chromium
from tests.report.sample import sample_folder

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no Chromium here: apt-get install chromium")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return report(sample_folder(tmp_path_factory.mktemp("results"), load_robot("hrp2like"), n_motions=2))


@pytest.fixture(scope="module")
def browser() -> Iterator[Chromium]:
    chromium = Chromium()
    yield chromium
    chromium.close()


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (400, True)])
def test_nothing_is_said_asked_for_or_cut_off(width: int, dark: bool, page: Path, browser: Chromium) -> None:
    """In the colours that the page was opened in, and in the others, to which the reader's system changes then."""
    browser.open(page, width, dark=dark)
    browser.wait("window.replays && replays.length === 1")
    browser.ask("Promise.all(replays.map((one) => one.ready)).then(() => 1)")
    for number in range(browser.ask("document.querySelectorAll('.interactive').length")):
        holder = f"document.querySelectorAll('.interactive')[{number}]"
        browser.ask(f"{holder}.scrollIntoView()")
        browser.wait(f"{holder}.classList.contains('ready')")
    paper = "getComputedStyle(document.body).backgroundColor"
    first = browser.ask(paper)
    for changed in (False, True):
        browser.look(dark=dark is not changed)
        assert (browser.ask(paper) != first) is changed
        assert browser.said == []
        assert browser.ask("replays[0].failed") is None
        assert browser.ask("document.documentElement.scrollWidth") <= width
        shown = "[...document.querySelectorAll('.plot, .replay-bar > *, .tile')]"
        cut_off = f"{shown}.filter((one) => one.getBoundingClientRect().right > innerWidth).length"
        assert browser.ask(cut_off) == 0


def test_a_long_name_of_a_robot_breaks_on_a_telephone(page: Path, browser: Chromium) -> None:
    """As makers' files have them: an underscore is no place where a line may break."""
    browser.open(page, 400)
    name = "arm_with_wrist_of_three_axes_and_gripper_of_50_mm"
    browser.ask(f"document.querySelector('h1').textContent = '{name}'")
    assert browser.ask("document.documentElement.scrollWidth") <= 400


def test_the_robot_moves_as_pinocchio_says(page: Path, browser: Chromium) -> None:
    robot = load_robot("hrp2like")
    browser.open(page, 1000)
    browser.wait("window.replays && replays.length === 1")
    browser.ask("replays[0].ready.then(() => 1)")
    motion = load_motion(page.parent / "motions" / "motion_01.parquet", robot).resampled(robot, FRAMES_HZ)
    browser.ask("replays[0].choose(1).then(() => 1)")
    data = robot.model.createData()
    for row in (0, 41, motion.n_samples - 1):
        browser.ask(f"replays[0].show({float(motion.time[row] - motion.time[0]) + 1e-4})")
        matrices = browser.ask("replays[0].body.joints.map((one) => one.matrix.toArray())")
        pin.forwardKinematics(robot.model, data, motion.q[row])
        for ours, theirs in zip(matrices, data.oMi, strict=True):
            np.testing.assert_allclose(np.reshape(ours, (4, 4)).T, theirs.homogeneous, atol=2e-3)
    margin = browser.ask("replays[0].bars.map((one) => one.margin.name)")
    assert margin[0] == "joint_position_rad" and "self_collision_m" in margin


def test_every_plot_says_its_units(page: Path, browser: Chromium) -> None:
    browser.open(page, 1000)
    browser.wait("window.replays && replays.length === 1")
    browser.ask("replays[0].ready.then(() => 1)")
    titles = browser.ask(
        "[...document.querySelectorAll('.replay .plot-title')].map((one) => one.textContent)"
    )
    assert len(titles) > 5 and [title for title in titles if not title.endswith("]")] == []
    assert browser.ask("document.querySelector('.replay .u-legend th').textContent").startswith("time [s]")
    assert browser.ask("replays[0].stage.hidden") is False


def test_what_is_folded_is_printed(page: Path, browser: Chromium) -> None:
    closed = "[...document.querySelectorAll('details:not([open]) table')]"
    hidden = f"{closed}.filter((one) => !one.checkVisibility({{ contentVisibilityAuto: true }})).length"
    browser.open(page, 800)
    assert browser.ask(f"{closed}.length") == browser.ask(hidden) > 0
    browser.look(media="print")
    browser.wait(f"{hidden} === 0", 5.0)


def test_it_plays_to_the_end_and_one_cursor_runs_over_all_plots(page: Path, browser: Chromium) -> None:
    browser.open(page, 1000)
    browser.wait("window.replays && replays.length === 1")
    browser.ask("replays[0].ready.then(() => 1)")
    browser.ask("replays[0].show(Number(replays[0].scrub.max) - 0.2), replays[0].play(true)")
    browser.wait("!replays[0].playing")
    assert browser.ask("replays[0].clock === Number(replays[0].scrub.max)")
    assert browser.ask("replays[0].button.textContent") == "Play"
    browser.ask("replays[0].drawn[0].over.scrollIntoView({block: 'center'})")
    box = browser.ask("(({x, y}) => [x, y])(replays[0].drawn[0].over.getBoundingClientRect())")
    browser.move_mouse(box[0] + 100, box[1] + 20)
    browser.wait("replays[0].drawn[0].cursor.idx > 0")
    cursors = browser.ask("replays[0].drawn.map((one) => one.cursor.idx)")
    assert len(cursors) >= 8 and len(set(cursors)) == 1 and cursors[0] > 0


def test_tables_sort_by_their_numbers(page: Path, browser: Chromium) -> None:
    browser.open(page, 1000)
    browser.ask("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    table = "document.querySelector('#masses table')"
    browser.ask(f"{table}.tHead.rows[0].cells[2].click()")
    values = browser.ask(f"[...{table}.tBodies[0].rows].map((row) => Number(row.cells[2].dataset.v))")
    assert values == sorted(values) and len(set(values)) > 3
    browser.ask(f"{table}.tHead.rows[0].cells[2].click()")
    assert browser.ask(f"{table}.tHead.rows[0].cells[2].getAttribute('aria-sort')") == "descending"
    assert browser.ask(f"{table}.tFoot.rows[0].cells[0].textContent") == "all"


def test_on_paper_the_drawings_stand_still(page: Path, browser: Chromium) -> None:
    browser.open(page, 1000, media="print")
    browser.wait("window.replays && replays.length === 1")
    browser.ask("replays[0].ready.then(() => 1)")
    shown = "getComputedStyle(document.querySelector('#motions .{}')).display"
    assert browser.ask(shown.format("still")) == "block"
    assert browser.ask(shown.format("replay")) == "none"


def test_joints_that_slide_have_metres_and_newtons(tmp_path: Path, browser: Chromium) -> None:
    body = (
        "<inertial><mass value='2'/><inertia ixx='.1' iyy='.1' izz='.1' ixy='0' ixz='0' iyz='0'/></inertial>"
        "<collision><geometry><box size='.1 .1 .1'/></geometry></collision>"
    )
    limit = "<limit lower='-.5' upper='.5' velocity='1' effort='90'/>"
    (tmp_path / "arm.urdf").write_text(
        f"<robot name='arm'><link name='root'/><link name='cart'>{body}</link><link name='bar'>{body}</link>"
        f"<joint name='rail' type='prismatic'><parent link='root'/><child link='cart'/>"
        f"<axis xyz='1 0 0'/>{limit}</joint>"
        "<joint name='turn' type='revolute'><parent link='cart'/><child link='bar'/><origin xyz='0 .4 0'/>"
        f"<axis xyz='0 1 0'/>{limit}</joint></robot>"
    )
    plan = excite.plan(excite.load_robot(tmp_path / "arm.urdf"), n_candidates=3, seed=1)
    page = report(plan.save(tmp_path / "plan"))
    # All are chosen: they are not compared with themselves.
    assert len(plan.motions) == 3 and "chosen motions alike" in page.read_text(encoding="utf-8")
    assert "rejected candidates" not in page.read_text(encoding="utf-8")
    browser.open(page, 1000)
    browser.wait("window.replays && replays.length === 1")
    browser.ask("replays[0].ready.then(() => 1)")
    shown = "[...document.querySelectorAll('.replay .plot-title')].map((one) => one.textContent)"
    units = {"position": "m", "velocity": "m/s", "torque": "N"}
    browser.ask(
        "(() => { const one = document.querySelector('.replay select[aria-label=joint]'); one.value = 0;"
        "one.dispatchEvent(new Event('change')); })()"
    )
    assert {f"{name} [{unit}]" for name, unit in units.items()} <= set(browser.ask(shown))
    nearest = "replays[0].bars.map((one) => [one.where.textContent, one.value.textContent])"
    for place, value in browser.ask(nearest)[:4]:
        assert ("rad" in value or "N·m" in value) == (place == "turn"), (place, value)
