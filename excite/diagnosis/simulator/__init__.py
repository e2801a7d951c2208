"""The augmented simulator of an arm, and its roll-outs against the record."""
