"""How good an identification is: validation, precision, what changed against the nominal model."""
