"""The next experiment: motions that would tell apart what a record leaves open."""
