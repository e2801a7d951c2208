"""The verbs that join rooms: plan, check, rank, simulate, and the whole loop with its journal."""
