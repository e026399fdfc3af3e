"""The front-end on a live stream: lost packets, clocks, health."""
