"""Estimates from a growing stream, with bounded time per estimate and bounded memory."""
