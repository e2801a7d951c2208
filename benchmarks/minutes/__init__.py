"""Seconds at the robot that planned motions need for their targets, and what each setting of the search is worth."""
