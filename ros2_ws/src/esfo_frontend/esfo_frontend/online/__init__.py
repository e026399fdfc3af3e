"""The front-end on a live stream: lost packets, clock offset, health of the stream."""
