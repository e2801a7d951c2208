"""A robot's description judged by itself, without a log."""
