"""A person as a robot: model from a subject, joint angles from markers, wrenches from force plates."""
