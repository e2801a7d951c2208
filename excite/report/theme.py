"""One look for every figure and for the page around them, light and dark.

Colours stand for roles. A figure drawn as SVG refers to them by CSS variable, so that it follows the
reader's light or dark setting; drawn as PNG it has the light ones. The three main colours are Okabe and
Ito's, which all common kinds of colour vision tell apart, and each role also has its own line or marker.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from excite.atomic import atomic_path
from excite.report.html import format_number

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Role:
    """A colour by what it stands for: ``light`` is used in figures, ``dark`` on a dark page."""

    name: str
    light: str
    dark: str


INK = Role("ink", "#1c2127", "#e6e9ed")
MUTED = Role("muted", "#5b6570", "#a3adb8")
PAPER = Role("paper", "#fefefe", "#1b2026")
IDENTIFIED = Role("identified", "#0072b2", "#5ab6ea")
NOMINAL = Role("nominal", "#d55e00", "#f39149")
TRUE = Role("true", "#009e73", "#3fc89f")
PALE = Role("pale", "#c9d3dd", "#4a5662")
GROUND = Role("ground", "#eceff3", "#262d35")
BODY = Role("body", "#b3bfcb", "#8a9aaa")
ROLES = (INK, MUTED, Role("grid", "#dfe3e8", "#38414b"), PAPER, IDENTIFIED, NOMINAL, TRUE, PALE, GROUND, BODY)

WIDTH_IN = 9.6
# Height of a line in figures [inch].
LINE_IN = 0.2
# Half of the width at the size of labels.
_LONGEST_LABEL = 60


@contextmanager
def _common_style() -> Iterator[None]:
    """Figures' style, without remarks on letters that the font lacks (the reader's has them) and on narrow panels."""
    import matplotlib

    style = Path(__file__).with_name("assets") / "figures.mplstyle"
    with matplotlib.rc_context(fname=style), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


def draw_figure(paint: Callable[[Figure], None], height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """A figure of that size [inch] in the common style, painted by ``paint``; no display is needed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with _common_style():
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasAgg(figure)
        paint(figure)
        _label_logarithms(figure)
    return figure


def shorten_name(text: str) -> str:
    """A name as it stands in a figure, where a long one would leave no room for the curves."""
    return text if len(text) <= _LONGEST_LABEL else text[: _LONGEST_LABEL - 1] + "…"


def _label_logarithms(figure: Figure) -> None:
    """Powers of ten at logarithmic axes as the page writes numbers: matplotlib's own need its formula language."""
    from matplotlib.ticker import LogFormatterSciNotation

    class Label(LogFormatterSciNotation):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return format_number(x, 1) if super().__call__(x, pos) else ""

    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if isinstance(axis.get_major_formatter(), LogFormatterSciNotation):
            axis.set_major_formatter(Label())
            axis.set_minor_formatter(Label(labelOnlyBase=False))


_DECIMALS = re.compile(r"-?\d+\.\d{3,}")


def to_svg(figure: Figure, name: str, description: str) -> str:
    """The figure as an ``<svg>`` element for inlining, the same bytes each time.

    Args:
        figure: from :func:`draw_figure`.
        name: unique on the page; prefixes the element's ids.
        description: what is to be seen, for readers who cannot see it.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.StringIO()
    with _common_style():
        # SVG counts in points. Room for labels is left now: what saves a figure draws all of it once more for that.
        figure.set_dpi(72)
        engine = figure.get_layout_engine()
        if engine is not None:
            engine.execute(figure)
            figure.set_layout_engine("none")
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{name}-", svg)
    svg = re.sub(r'\s(width|height)="[\d.]+pt"', "", svg, count=2)
    # Places of lines are as good to a hundredth of a point; what is written between tags is not theirs.
    svg = re.sub(r"<[^>]*>", lambda tag: _DECIMALS.sub(lambda place: f"{float(place[0]):.2f}", tag[0]), svg)
    for role in ROLES:
        svg = svg.replace(role.light, f"var(--{role.name})")
    return svg.replace("<svg ", f'<svg role="img" aria-label="{escape(description)}" ', 1)


def to_png(figure: Figure, dpi: int = 150) -> bytes:
    """The figure as a PNG on white paper."""
    buffer = io.BytesIO()
    with _common_style():
        figure.savefig(buffer, format="png", dpi=dpi, facecolor=PAPER.light, metadata={"Software": None})
    return buffer.getvalue()


def save_png(figure: Figure, path: str | Path) -> Path:
    """Write the figure as a PNG, which appears only when complete."""
    with atomic_path(Path(path)) as temporary:
        temporary.write_bytes(to_png(figure))
    return Path(path)


def css_variables(dark: bool) -> str:
    """Declarations of the roles' CSS variables."""
    return " ".join(f"--{role.name}: {role.dark if dark else role.light};" for role in ROLES)
