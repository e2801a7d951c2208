"""Effects that a floating-base log can show, one a file."""
