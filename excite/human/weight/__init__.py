"""The weight of a person, and a weight that is worn."""
