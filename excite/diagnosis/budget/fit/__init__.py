"""Gram matrices of all columns, and models fitted with some of them."""
