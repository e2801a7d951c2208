"""Words that columns are called by in drivers, middleware, vendors' loggers and papers: the table ``words.csv``."""

from __future__ import annotations

from excite.data_tables import read_rows

_ROWS = [(row["meaning"], row["words"].split()) for row in read_rows(__file__, "words.csv")]


def _words(*meanings: str) -> frozenset[str]:
    return frozenset(word for meaning, words in _ROWS if meaning in meanings for word in words)


_QUANTITIES = ("skip", "time", "a", "v", "tau", "i", "volt", "q")
OF_WORD = {word: meaning for meaning, words in _ROWS if meaning in _QUANTITIES for word in words}
"""Words by the quantity that they name."""
OF_HANDS = _words("hand")
SURELY_COMMANDED = _words("commanded, surely")
"""Words that mean nothing else: what a robot of one joint is asked for needs no other word."""
COMMANDED = _words("commanded, surely", "commanded, perhaps")
MEASURED = _words("measured")
SURELY_MEASURED = _words("measured, surely")
FORCES = _words("force")
OF_MESSAGE = _words("message")
ASIDE = _words("aside")
SHARES = _words("share")
OF_MOTOR = _words("motor side")
NOISE = _words("filler")
KNOWN = frozenset(OF_WORD) | COMMANDED | MEASURED | NOISE
