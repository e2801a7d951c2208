"""What the package stands on: the distributions that it and its tests need, and their licences."""
