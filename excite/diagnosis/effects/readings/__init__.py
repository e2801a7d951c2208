"""Effects of readings and drives: gains, biases, offsets, delays, lags."""
