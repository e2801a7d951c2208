"""What is watched, as one HTML file that needs neither a server nor a network."""

from __future__ import annotations

from html import escape
from pathlib import Path

from excite.atomic import write_text
from excite.report.html import html_paragraph
from excite.report.live import live_replay
from excite.report.page import html_page
from excite.report.replay.scene import robot_scene
from excite.viewer.thing import Thing

_HOW = (
    "Drag the picture to look from elsewhere. One cursor runs over all plots: a click takes the robot there, a drag "
    "along a plot zooms, a double click shows all of it again."
)


def record_page(thing: Thing, path: Path) -> Path:
    """Write the page; appears only when complete.

    Args:
        thing: what is watched.
        path: the HTML file.
    """
    tracks = {clip.title: clip.content for clip in thing.clips}
    still = html_paragraph(
        "Open this page in a browser that runs scripts and draws WebGL to see it move.", "lead"
    )
    shown = live_replay("view", robot_scene(thing.robot), tracks, still)
    title = thing.robot.description.title
    body = (
        f"<header><p>{escape(thing.title)}</p><h1>{escape(title)}</h1></header>"
        f'<main><section id="moving">{html_paragraph(_HOW, "lead moving")}{shown}</section></main>'
    )
    return write_text(Path(path), html_page(thing.title, body))
