"""Event track clustering of the paper (section 4): density filter, clusters, joining, windows."""
