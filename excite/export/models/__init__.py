"""Robot models with identified inertial parameters."""
