"""A first ``robot.yaml`` for a model of one's own."""
