"""Programs and streams for arms whose makers have formats of their own."""
