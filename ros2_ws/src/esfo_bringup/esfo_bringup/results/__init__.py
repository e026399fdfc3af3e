"""What a run leaves behind: files, figures, report, summary."""
