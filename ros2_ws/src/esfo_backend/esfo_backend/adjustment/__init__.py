"""Optimisation of orbit and landmarks, and its covariance."""
