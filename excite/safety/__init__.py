"""The independent check of a motion, and repairs of what it finds."""
