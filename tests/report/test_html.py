"""Numbers and cells as a reader sees them."""

from __future__ import annotations

import doctest

import pytest

from excite.report import html


def test_examples_in_docstrings():
    assert doctest.testmod(html).failed == 0


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.00123, "−0.00123"),
        (99999.0, "99999"),
        (123456.0, "1.23 · 10⁵"),
        (-2.5e-7, "−2.50 · 10⁻⁷"),
        (float("nan"), "–"),
    ],
)
def test_numbers(value, text):
    assert html.format_number(value) == text


def test_text_is_escaped_and_numeric_columns_stand_right():
    page = html.html_table(("<name>", "value"), [("a & b", 1.0), ("c", None)])
    assert "&lt;name&gt;" in page and "a &amp; b" in page and "<name>" not in page
    assert page.count('class="number"') == 3


def test_commands_in_a_sentence_are_typed() -> None:
    assert (
        html.html_paragraph("`excite diagnose` tells < more")
        == "<p><code>excite diagnose</code> tells &lt; more</p>"
    )


def test_a_number_in_words_sorts_as_the_number_that_it_is() -> None:
    text = html.html_table(
        ("RSD",), [(html.Said(4e9, "not shown"),), (html.Said(None, "not shown"),), (3.0,)]
    )
    assert '<td class="number" data-v="4e+09">not shown</td>' in text
    assert '<td class="number">not shown</td>' in text
    assert '<th class="number">' in text
