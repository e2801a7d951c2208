"""The effects that a diagnosis knows, one file each."""
