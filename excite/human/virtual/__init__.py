"""A virtual person in a virtual motion laboratory, whose every number is known."""
