"""Result files of a run: orbit, points, tracks, figures and report."""
