"""Event tracking by clustering: events in, corner clusters and feature tracks out."""

__version__ = "0.1.0"
