"""From a PadTrack and a Goal to a velocity. Pure."""
