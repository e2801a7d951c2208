"""The commands that bring recordings in."""
