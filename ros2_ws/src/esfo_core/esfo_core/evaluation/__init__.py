"""Errors of results against a known truth: orbit, structure and tracks."""
