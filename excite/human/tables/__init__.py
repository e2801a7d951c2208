"""Published inertial parameters of body segments, number by number."""
