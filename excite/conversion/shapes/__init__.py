"""Shapes of tables other than a row a sample and a column a channel, brought to that one."""
