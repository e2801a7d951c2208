"""Documents of commands on fixed inputs, kept, so that a change that is to change nothing is seen to."""
