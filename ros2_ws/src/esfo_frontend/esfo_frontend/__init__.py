"""Front-end: detects corners in a stream of events and tracks them as features."""

__version__ = "0.1.0"
