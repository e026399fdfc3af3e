"""Measurements of `esfo benchmark`: accuracy of the orbit and of the tracks against the truth, and throughput."""
