"""The JSON documents that are written and read again: what each field has to be."""
