"""What is wrong with a log, and what can be repaired."""
