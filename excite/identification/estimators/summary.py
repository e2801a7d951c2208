"""What there is to say about each method in a line: what it is, when to take it, what it promises, its settings."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields

from excite.identification.estimators.registry import DEFAULT_METHOD, ESTIMATORS


@dataclass(frozen=True)
class MethodSummary:
    """A method in a line.

    Attributes:
        name: what one types.
        title: what it is.
        use: when to take it.
        guarantees: what holds for every result that it returns.
        consistent: whether its bodies can exist.
        default: whether it is taken where none is named.
        settings: names of its settings, without those that all methods share.
    """

    name: str
    title: str
    use: str
    guarantees: str
    consistent: bool
    default: bool
    settings: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """The fields by name, ready for JSON."""
        return {**asdict(self), "settings": list(self.settings)}


def method_summaries() -> tuple[MethodSummary, ...]:
    """All methods of identification, in the registry's order."""
    shared = set.intersection(
        *({item.name for item in fields(kind.settings_class)} for kind in ESTIMATORS.values())
    )
    return tuple(
        MethodSummary(
            name=name,
            title=kind.title,
            use=kind.use,
            guarantees=kind.guarantees,
            consistent=kind.consistent,
            default=name == DEFAULT_METHOD,
            settings=tuple(item.name for item in fields(kind.settings_class) if item.name not in shared),
        )
        for name, kind in ESTIMATORS.items()
    )
