"""The pipeline without ROS: opening a recording, tracking it, estimating its orbit."""
