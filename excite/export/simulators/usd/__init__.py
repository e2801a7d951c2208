"""USD, the format of Isaac Sim, Isaac Lab and Newton: how it is written as text and how it is read."""
