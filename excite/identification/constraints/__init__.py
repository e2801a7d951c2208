"""What inertial parameters must satisfy: masses, pseudo-inertias, bounds."""
