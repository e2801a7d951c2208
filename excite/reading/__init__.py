"""Files that people hand over, read within bounds: size, depth and count are checked before any reader trusts them."""
