"""Files that were damaged at random, handed to the commands that read them."""
