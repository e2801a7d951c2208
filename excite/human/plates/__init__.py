"""Force plates: their readings, their moments about the ground, the ground reaction."""
