"""Commands that show what was found: as a page, in the browser."""
