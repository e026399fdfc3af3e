"""Simulated recordings and tracks with exact truth."""

__version__ = "0.1.0"
