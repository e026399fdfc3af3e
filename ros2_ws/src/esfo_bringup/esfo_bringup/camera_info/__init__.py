"""Node that publishes a calibration, for cameras whose driver does not."""
