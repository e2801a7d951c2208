"""One model of the gap: baseline, any number of effects at any places, what has no name, and noise; as a budget."""
