"""Known effects planted in recordings of real robots, and what a diagnosis says of them."""
