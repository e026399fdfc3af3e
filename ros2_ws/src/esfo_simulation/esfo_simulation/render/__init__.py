"""Rendering: surfaces in any pose to images of log intensity."""
