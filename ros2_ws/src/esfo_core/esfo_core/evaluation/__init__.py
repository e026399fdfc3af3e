"""Results beside a truth: orbit, structure and tracks."""
