"""The manual: its pages build, its examples run, and it leaves nothing out."""
