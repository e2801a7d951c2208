"""What is put right in a recording before it is understood or cut: seams, signs, rows that hold nothing."""
