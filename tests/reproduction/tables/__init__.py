"""One module a paper, each with ``tables() -> list[Table]``."""
