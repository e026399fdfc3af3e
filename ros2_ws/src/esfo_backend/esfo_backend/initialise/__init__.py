"""Initial values of the orbit: COLMAP (paper) or the axis search."""
