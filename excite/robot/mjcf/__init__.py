"""A MuJoCo model turned into a URDF."""
