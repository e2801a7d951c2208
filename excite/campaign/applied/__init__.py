"""A robot with the effects that a diagnosis found."""
