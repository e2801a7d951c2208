"""What the doctor looks at in a log, one concern each: they find, and repair what can be repaired."""
