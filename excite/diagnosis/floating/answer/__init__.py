"""The map of the gap and its curves for robots with a free base."""
