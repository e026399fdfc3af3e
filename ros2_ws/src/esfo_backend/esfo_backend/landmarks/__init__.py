"""Landmarks: association of tracks with points of the object."""
