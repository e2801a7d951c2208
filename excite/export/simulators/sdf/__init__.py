"""SDF, the format of Gazebo: how it is written and how it is read."""
