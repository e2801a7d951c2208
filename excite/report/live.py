"""What moves on a page: its scripts, which nothing but the page itself can run, and the data that they show.

A page works without them: what moves stands beside what does not, which is shown where no script runs and in print.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.report.replay.packed import pack_table

# Scripts by what of a page needs them, in the order in which they are run.
_PLOTS, _REPLAY = "data-chart=", "data-replay="
_SCRIPTS = {
    "uplot.min.js": (_PLOTS, _REPLAY),
    "three.min.js": (_REPLAY,),
    "page.js": ("<",),
    "replay.js": (_REPLAY,),
}
_MOST_POINTS = 3000


def data_island(identifier: str, content: Any, title: str = "") -> str:
    """Data of the page for its scripts: JSON in which no text can end the element."""
    try:
        text = _write_json_text(content)
    except ValueError:
        text = _write_json_text(_check_finite(content))
    for char in "<>&\u2028\u2029":
        text = text.replace(char, f"\\u{ord(char):04x}")
    named = f' data-title="{escape(title)}"' if title else ""
    return f'<script type="application/json" id="{identifier}"{named}>{text}</script>'


def live_chart(
    identifier: str,
    time: Array,
    panels: Sequence[Mapping[str, Any]],
    still: str,
) -> str:
    """Plots over one time, under one cursor; the drawing ``still`` where no script runs, and in print.

    Args:
        identifier: unique on the page.
        time: ``(n,)`` [s].
        panels: each ``title``, ``unit`` and ``series``: pairs of what describes a line (``label``, ``role``, ``dash``)
            and its values, ``(n,)``.
        still: HTML.
    """
    shown = slice(None, None, max(1, math.ceil(len(time) / _MOST_POINTS)))
    drawn = []
    for panel in panels:
        lines = [line for line, _ in panel["series"]]
        values = pack_table(np.column_stack([values[shown] for _, values in panel["series"]]))
        drawn.append({**panel, "series": lines, "values": values})
    spec = {"group": identifier, "time": pack_table(time[shown]), "panels": drawn}
    name = f"{identifier}-data"
    moving = f'<div class="moving plots" data-chart="{name}"></div>'
    return f'<div class="interactive">{moving}<div class="still">{still}</div>{data_island(name, spec)}</div>'


def live_replay(identifier: str, robot: Any, tracks: Mapping[str, Any], still: str) -> str:
    """A robot in motion; ``still`` where no script runs or nothing can be drawn, and in print.

    Args:
        identifier: unique on the page.
        robot: of :func:`~excite.report.replay.scene.robot_scene`.
        tracks: by title, of :class:`~excite.report.replay.tracks.Tracks`.
        still: HTML.
    """
    scene, names = f"{identifier}-robot", [f"{identifier}-{i}" for i in range(len(tracks))]
    data = [data_island(name, *pair[::-1]) for name, pair in zip(names, tracks.items(), strict=True)]
    moving = f'<div class="moving replay" data-replay="{scene}" data-tracks="{" ".join(names)}"></div>'
    return (
        f'<div class="interactive">{moving}<div class="still">{still}</div>'
        f"{data_island(scene, robot)}{''.join(data)}</div>"
    )


def body_scripts(body: str) -> str:
    """The scripts that a page's body needs."""
    return "".join(f"<script>{_read_asset(name)}</script>" for name in _needed_scripts(body))


def content_policy(body: str) -> str:
    """What the page's reader is told to allow it: its own scripts by their hashes, its own style, and no request."""
    hashes = " ".join(f"'sha256-{_asset_hash(name)}'" for name in _needed_scripts(body))
    rules = (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )
    return f'<meta http-equiv="Content-Security-Policy" content="{rules}">'


def plot_style() -> str:
    """The plots' style sheet."""
    return _read_asset("uplot.min.css")


def _needed_scripts(body: str) -> list[str]:
    return [name for name, signs in _SCRIPTS.items() if any(sign in body for sign in signs)]


@cache
def _read_asset(name: str) -> str:
    return (files("excite.report") / "assets" / name).read_text(encoding="utf-8").strip()


@cache
def _asset_hash(name: str) -> str:
    return base64.b64encode(hashlib.sha256(_read_asset(name).encode()).digest()).decode("ascii")


def _write_json_text(content: Any) -> str:
    """JSON; raises ValueError where a number is not finite, which JSON cannot say."""
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _check_finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _check_finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_check_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
