"""Standing robots of a blind benchmark: exact dynamics of planned motions, contacts at the feet, noisy sensors."""
