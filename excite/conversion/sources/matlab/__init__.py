"""Files that MATLAB saves, and what in them is no array."""
