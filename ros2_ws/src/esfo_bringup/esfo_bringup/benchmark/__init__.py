"""What `esfo benchmark` measures: accuracy of the orbit and of the tracks against truth, and throughput."""
