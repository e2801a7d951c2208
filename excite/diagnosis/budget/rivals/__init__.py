"""What might stand in the place of a term of the model of the gap."""
