"""The calibration of a camera whose driver does not publish one."""
