"""What the torques and currents of a recording are worth, by the nominal model."""
