"""The search for effects that explain the gap of an arm."""
