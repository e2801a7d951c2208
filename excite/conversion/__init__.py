"""Any recording that people bring, made a log folder: read, understood, joined, cut into trials."""
