"""What every effect promises."""
