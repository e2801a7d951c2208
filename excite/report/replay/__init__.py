"""What a page needs to show a robot in motion: its bodies, its joints, and tracks over time."""
