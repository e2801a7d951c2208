"""Effects of forces that depend on the joint's position: springs, ripple."""
