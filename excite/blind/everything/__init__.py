"""Arms with a little of everything: several effects of any size at once, and what each takes of every joint's gap."""
