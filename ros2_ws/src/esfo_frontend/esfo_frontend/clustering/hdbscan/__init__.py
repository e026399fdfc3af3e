"""HDBSCAN in numba, and the package `hdbscan` beside it."""
