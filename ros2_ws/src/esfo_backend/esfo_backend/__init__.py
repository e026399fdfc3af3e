"""Back-end: spin rate, initialisation and the factor graph over the orbit."""

__version__ = "0.1.0"
