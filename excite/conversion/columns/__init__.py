"""What single columns are: their names, joints, clocks and units."""
