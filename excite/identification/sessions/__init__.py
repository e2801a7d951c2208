"""Several sessions of one robot, compared."""
