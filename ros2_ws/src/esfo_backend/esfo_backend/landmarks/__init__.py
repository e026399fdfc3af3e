"""Landmarks: which tracks are of the same point of the object."""
