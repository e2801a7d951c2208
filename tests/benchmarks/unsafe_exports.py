"""A thousand spoilt motions on their way to a controller: what is unsafe does not leave without the override."""

from __future__ import annotations

from collections import Counter

from excite.parallel.engine import in_order
from tests.benchmarks.table import Row
from tests.export.unsafe_cases import MUTATED, cases, outcome

_COUNT = 1000


def rows() -> list[Row]:
    """How many leave although they are unsafe, by an oracle that shares no code with the check."""
    found = list(in_order(outcome, cases(_COUNT), jobs=2, stage="spoilt motions"))
    out = [item for item in found if not item.refused]
    unsafe = [item for item in found if item.wrong]
    left = [item for item in found if item.left]
    kinds = Counter(item.kind for item in unsafe)
    named = f" ({', '.join(f'{count} {kind}' for kind, count in kinds.most_common())})" if kinds else ""
    return [
        Row.holds(
            f"unsafe motions exported without the override, {len(MUTATED)} ways to spoil one",
            f"0 of {_COUNT}",
            f"{len(unsafe)} of {_COUNT}{named}",
            not unsafe,
        ),
        Row.holds("… refused with a file left behind", "0", str(len(left)), not left),
        Row("… exported, and harmless by the oracle", "", f"{len(out) - len(unsafe)} of {_COUNT}", None),
    ]
