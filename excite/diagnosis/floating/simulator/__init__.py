"""The augmented simulator of robots with a free base, and its roll-outs."""
