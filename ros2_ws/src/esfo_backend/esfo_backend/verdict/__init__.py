"""From an optimum to an estimate: statistics, status and flags."""
