"""How much a motion tells of the parameters: ranking, choice and optimisation."""
