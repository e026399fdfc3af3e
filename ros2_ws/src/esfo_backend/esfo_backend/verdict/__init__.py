"""Evaluation of an optimum: statistics, status and flags."""
