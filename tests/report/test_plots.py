"""Figures: what they draw, read back from the drawing."""

from __future__ import annotations

import dataclasses
import re
from io import BytesIO

import numpy as np
import pinocchio as pin
import pytest
from defusedxml.ElementTree import fromstring
from PIL import Image
from scipy.spatial import ConvexHull

from excite.report.comparisons import ForceComparison
from excite.report.plots.curves import channel_panels, draw_panels
from excite.report.plots.postures import (
    choose_motions,
    different_instants,
    draw_posture,
    draw_snapshots,
    hull_outline,
    project_points,
)
from excite.report.replay.scene import shape_triangles
from excite.report.sections.identified import draw_masses, plot_rsd
from excite.report.sections.motions import draw_conditioning
from excite.report.theme import ROLES, to_png, to_svg
from excite.robot.shapes.shape import Shape
from tests.report.sample import sample_data, sample_motion


@pytest.fixture(scope="module")
def data(g1):
    return sample_data(g1)


def _curves(data):
    return draw_panels(data.time, channel_panels(data))


def _bars(figure):
    """Ends of the pale and of the strong bars, and the axes that they stand on."""
    (axes,) = figure.axes
    return np.array([bar.get_x() + bar.get_width() for bar in axes.patches]).reshape(2, -1), axes


def test_condition_numbers_are_bars_from_one_on_a_log_axis(data):
    (before, after), axes = _bars(draw_conditioning(data.conditioning))
    assert axes.get_xscale() == "log" and {bar.get_x() for bar in axes.patches} == {1.0}
    np.testing.assert_allclose(after, data.conditioning.after)
    np.testing.assert_allclose(before[:-1], data.conditioning.before[:-1])
    # What nothing excites reaches the edge.
    assert before[-1] == axes.get_xlim()[1] > np.nanmax(after)
    assert f"∞ → {data.conditioning.after[-1]:.3g}" in {text.get_text() for text in axes.texts}


def test_numbers_of_a_figure_are_not_rounded_with_the_places_of_its_lines():
    """Torques of a thousandth of a newton metre had the scale 0.00, 0.00, -0.00, and 0.125 stood there as 0.12."""
    time = np.linspace(0.0, 1.0, 50)
    measured = 0.004 * np.sin(9.0 * time)[:, None]
    figure = _curves(ForceComparison("one", ("a",), ("N·m",), time, measured, 0.5 * measured, 0.9 * measured))
    root = fromstring(to_svg(figure, "small", "what it shows"))
    texts = [
        "".join(item.itertext()).strip().replace("−", "-")
        for item in root.iter()
        if item.tag.endswith("text")
    ]
    assert {"-0.004", "-0.002", "0.002", "0.004"} <= set(texts) and "-0.00" not in texts
    (title,) = (text for text in texts if "RMSE" in text)
    rmse = float(np.sqrt(np.mean((0.5 * measured) ** 2)))
    assert f"RMSE {rmse:.3g} → {0.2 * rmse:.3g} N·m" in title


def test_masses_show_all_three_and_mark_what_changed(data):
    masses = data.masses
    (nominal, identified), axes = _bars(draw_masses(masses))
    np.testing.assert_allclose(nominal, masses.nominal)
    np.testing.assert_allclose(identified, masses.identified)
    (spans,) = axes.collections
    ends = np.array([part[:, 0] for part in spans.get_segments()])
    np.testing.assert_allclose(ends.mean(axis=1), masses.identified)
    np.testing.assert_allclose(np.ptp(ends, axis=1), 2.0 * masses.half_width)
    ticks = next(line for line in axes.lines if line.get_label() == "true")
    np.testing.assert_allclose(ticks.get_xdata(), masses.true)
    names = axes.get_yticklabels()
    bold = [name for name, text in zip(masses.names, names, strict=True) if text.get_fontweight() == "bold"]
    assert bold == [name for name, flag in zip(masses.names, masses.changed, strict=True) if flag]
    (untold,) = draw_masses(dataclasses.replace(masses, true=None)).axes
    assert "true" not in untold.get_legend_handles_labels()[1]


@pytest.mark.parametrize("n_channels", [1, 6, 7])
def test_forces_have_a_panel_a_channel_with_unit_and_rmse(n_channels):
    time = np.linspace(0.0, 1.0, 9000)
    measured = np.zeros((len(time), n_channels))
    names = tuple(f"joint{i}" for i in range(n_channels))
    data = ForceComparison("t", names, ("N·m",) * n_channels, time, measured, measured + 2.0, measured - 0.5)
    panels = [axes for axes in _curves(data).axes if axes.get_visible()]
    assert [axes.get_title("left") for axes in panels] == [f"{name}, RMSE 2 → 0.5 N·m" for name in names]
    assert {axes.get_ylabel() for axes in panels} == {"[N·m]"}
    assert all(len(line.get_xdata()) <= 3000 for axes in panels for line in axes.lines)


def test_rsd_points_fall_where_they_belong():
    steps = [{"n_motions": 3, "rsd_percent": {"a": 1.0, "b": 40.0, "c": None}, "not_met": ["b", "c"]}]
    axes = plot_rsd(steps, target_percent=15.0).axes[0]
    met, missed = axes.lines[:2]
    assert list(met.get_ydata()) == [1.0]
    np.testing.assert_array_equal(missed.get_ydata(), [40.0, np.nan])
    assert "1 of 3" in axes.get_xticklabels()[0].get_text()
    assert "target 15 %" in [text.get_text() for text in axes.texts]


def test_a_picture_stands_on_the_ground_with_its_mass_over_its_feet(g1):
    drawn = draw_posture(g1, g1.rest, frozenset(foot.name for foot in g1.feet))
    com = pin.centerOfMass(g1.model, g1.model.createData(), g1.rest) * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(drawn.com, project_points((com - [*g1.rest[:2], 0.0])[None])[0])
    low, high = drawn.support.min(axis=0), drawn.support.max(axis=0)
    assert (low < drawn.com).all() and (drawn.com < high).all()
    assert len(drawn.soles) == 2 and len(drawn.hulls) > 15
    assert draw_posture(g1, g1.rest, frozenset()).support is None


@pytest.mark.parametrize(
    ("kind", "size", "extent"),
    [
        ("sphere", (0.1,), (0.2, 0.2, 0.2)),
        ("box", (0.1, 0.2, 0.3), (0.1, 0.2, 0.3)),
        ("cylinder", (0.1, 0.5), (0.2, 0.2, 0.5)),
        ("capsule", (0.1, 0.5), (0.2, 0.2, 0.7)),
    ],
)
def test_round_shapes_have_their_size(kind, size, extent):
    points, _ = shape_triangles(Shape("s", "l", 1, pin.SE3.Identity(), kind, size))
    np.testing.assert_allclose(np.ptp(points, axis=0), extent, rtol=0.03)


def test_instants_differ_and_are_in_order(g1):
    motion = sample_motion(g1, 1)
    instants = different_instants(motion, 5)
    assert instants[0] == 0 and (np.diff(instants) > 0).all() and len(instants) == 5
    postures = motion.joint_positions()[instants]
    chosen = min(np.linalg.norm(a - b) for i, a in enumerate(postures) for b in postures[:i])
    even = motion.joint_positions()[np.linspace(0, motion.n_samples - 1, 5).astype(int)]
    assert chosen > min(np.linalg.norm(a - b) for i, a in enumerate(even) for b in even[:i])


def test_each_generator_is_shown_first(g1):
    motions = [sample_motion(g1, seed, n=20) for seed in (0, 3, 6, 1, 4, 2)]
    names = [motion.name for motion in choose_motions(motions, 4)]
    assert {"motion_00", "motion_01", "motion_02"} < set(names) and len(names) == 4
    assert choose_motions(motions, 10) == motions


def test_drawings_follow_the_page_and_pictures_are_light(data):
    figure = _curves(data.forces)
    svg = to_svg(figure, "one", "what it shows")
    assert 'aria-label="what it shows"' in svg and "var(--identified)" in svg
    assert not any(role.light in svg for role in ROLES)
    assert 'id="one-' in svg and svg == to_svg(figure, "one", "what it shows")
    assert to_png(figure, dpi=20).startswith(b"\x89PNG")


def test_a_row_of_postures_is_drawn_in_full_on_the_page_and_as_a_picture(g1):
    motion = sample_motion(g1, 0)
    figure = draw_snapshots(g1, [dataclasses.replace(motion, name="a < b & c")], n_postures=3)
    svg = to_svg(figure, "row", 'what "it" shows')
    root = fromstring(svg)
    assert root.get("aria-label") == 'what "it" shows'
    drawn = draw_posture(g1, motion.q[0], frozenset())
    outlines = list(root.iter("{http://www.w3.org/2000/svg}path"))
    assert len(outlines) >= 3 * (len(drawn.hulls) + len(drawn.soles))
    words = [text.text for text in root.iter("{http://www.w3.org/2000/svg}text")]
    assert words[0] == "0.0 s" and words[-1].startswith("a < b & c") and len(words) == 4
    assert not re.findall(r"#[0-9a-f]{6}", svg)
    with Image.open(BytesIO(to_png(figure, dpi=36))) as image:
        assert image.size == pytest.approx(tuple(36 * figure.get_size_inches()), abs=1.0)
        assert {(0, 114, 178), (28, 33, 39)} & {
            colour for _, colour in image.convert("RGB").getcolors(1 << 20)
        }
    # Nothing is cut off.
    (axes,) = figure.axes
    points = np.vstack([path.vertices for one in axes.collections for path in one.get_paths()])
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    assert (points >= low).all() and (points <= high).all()


# Outlines of shapes in pictures of a robot.


def test_an_outline_has_the_corners_of_the_hull_anticlockwise() -> None:
    corners = np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.0, 0.1], [0.1, 0.05]])
    found = hull_outline(corners).tolist()
    assert found[found.index(0) :] + found[: found.index(0)] == [0, 1, 2, 3]


@pytest.mark.parametrize("seed", range(5))
def test_nothing_sticks_out_that_could_be_seen(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ball = rng.normal(size=(96, 3))
    points = (ball / np.linalg.norm(ball, axis=1)[:, None] * rng.uniform(0.02, 0.3, 3))[:, :2]
    found = points[hull_outline(points)]
    area = 0.5 * np.sum(found[:, 0] * np.roll(found[:, 1], -1) - found[:, 1] * np.roll(found[:, 0], -1))
    assert 0.995 * ConvexHull(points).volume < area <= ConvexHull(points).volume + 1e-12


@pytest.mark.parametrize("points", [np.zeros((4, 2)), np.outer(np.arange(3.0), [1.0, 2.0])])
def test_what_has_no_area_has_no_outline(points: np.ndarray) -> None:
    assert len(hull_outline(points)) < 3
