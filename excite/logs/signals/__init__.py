"""Signal processing: one concept a file."""
