"""A first description of a robot of one's own."""
