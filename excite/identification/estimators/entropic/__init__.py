"""The entropic divergence between bodies as an objective, and the method that solves for it."""
