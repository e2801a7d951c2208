"""A motion, a plan, a log or a diagnosis, moving in the browser."""
