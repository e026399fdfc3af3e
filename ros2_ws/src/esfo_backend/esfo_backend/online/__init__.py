"""Estimates from a growing stream, in bounded work and memory."""
