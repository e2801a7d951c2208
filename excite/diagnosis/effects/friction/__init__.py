"""Effects of friction in the joints."""
