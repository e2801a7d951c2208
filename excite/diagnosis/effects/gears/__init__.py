"""Effects of gears and rotors: armature, play, elasticity."""
