"""Spin rate from the event activity, before any geometry."""
