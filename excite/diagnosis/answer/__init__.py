"""What a diagnosis says: gap, candidates, curves, and their words and tables."""
