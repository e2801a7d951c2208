"""Parameters that bodies can have, certified: bounds and their file, the feasible set, relaxation, search."""
