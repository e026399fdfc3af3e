"""Launch files, the replay node and the esfo command."""

__version__ = "0.1.0"
