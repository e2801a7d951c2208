"""Effects that were found, in the equations of an arm one after the other."""
