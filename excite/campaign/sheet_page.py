"""The sheet of ``excite capture`` as a page: on a phone beside the robot, in the dark, on paper."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import escape

from excite.report.page import html_page


def sheet_page(text: str) -> str:
    """A page of the sheet's Markdown: headings, lists, one table, and the block for ``excite convert``, folded.

    Args:
        text: as :func:`~excite.campaign.capture.sheet_text` makes it.
    """
    before, _, rest = text.partition("```yaml\n")
    first, *parts = re.split(r"^## ", before, flags=re.MULTILINE)
    title, _, lead = first.removeprefix("# ").partition("\n")
    # Its heading stands beside the block.
    sections = "".join(_render_section(part) for part in parts[:-1])
    block = (
        f"<section><details><summary>{_render_inline(parts[-1].strip())}</summary>"
        f'<pre class="capture">\n{escape(rest.partition("```")[0], quote=False)}</pre></details></section>'
    )
    head = f"<header><p>The sheet for the minutes at the robot</p><h1>{escape(title)}</h1></header>"
    answer = f'<section class="answer"><p class="verdict">{_render_inline(lead.strip())}</p></section>'
    return html_page(title, f"{head}\n<main>{answer}{sections}{block}</main>\n")


def _render_section(part: str) -> str:
    title, _, body = part.partition("\n")
    return f"<section><h2>{_render_inline(title)}</h2>{''.join(_render_blocks(body))}</section>"


def _render_blocks(body: str) -> Iterator[str]:
    """The table or the list of a section; a line that goes on stands indented."""
    lines = [line for line in re.sub(r"\n  (?=\S)", " ", body).splitlines() if line]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    if rows:
        head, _, *cells = rows
        names = "".join(f"<th>{_render_inline(cell)}</th>" for cell in head)
        told = "".join(
            f"<tr>{''.join(f'<td>{_render_inline(cell)}</td>' for cell in row)}</tr>" for row in cells
        )
        yield f'<div class="wide"><table><thead><tr>{names}</tr></thead><tbody>{told}</tbody></table></div>'
    items = "".join(
        f"<li>{_render_inline(line.removeprefix('- '))}</li>" for line in lines if line.startswith("- ")
    )
    yield f"<ul>{items}</ul>" if items else ""


def _render_inline(text: str) -> str:
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text, quote=False))
