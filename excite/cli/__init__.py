"""The commands, one module each: they read options, call a verb and print."""
