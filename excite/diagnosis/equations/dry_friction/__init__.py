"""Dry friction of joints: how it changes sign, what builds it up, where it holds them."""
