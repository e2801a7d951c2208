"""Benchmarks of the package: cases whose answers are withheld. Part of the repository, not of what is installed."""
