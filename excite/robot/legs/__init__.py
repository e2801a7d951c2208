"""What legs have to hold for a robot to stand on them."""
