"""The event sensor: images of log intensity to events."""
