"""Corner events on the surface of active events."""
