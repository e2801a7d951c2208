"""What a folder comes to, one file a kind of result."""
