"""The search for effects of robots with a free base."""
