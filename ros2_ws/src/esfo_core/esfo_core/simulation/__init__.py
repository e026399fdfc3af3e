"""Simulated recordings and tracks with exact truth."""
