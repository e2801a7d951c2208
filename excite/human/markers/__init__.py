"""Skin markers: where they sit, what they are called, and the joint angles that they say."""
