"""Entries of the blind benchmark: answers that programs wrote, and two plain programs that write some."""
