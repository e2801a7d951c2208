"""One way from a log to filtered, differentiated rows of equations."""
