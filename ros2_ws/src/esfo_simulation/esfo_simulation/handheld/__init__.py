"""A hand-held camera in a room: scenes in the manner of the Event Camera Dataset."""
