"""Bad input by family: each case is some files and a command line, and ends in one line that says what to do."""
