"""Where a plan's candidates come from: generators that draw them one by one, and searches for all of them at once."""
