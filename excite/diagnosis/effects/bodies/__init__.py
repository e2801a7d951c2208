"""Effects of bodies and their placement: payload, link lengths, tilt of the base."""
