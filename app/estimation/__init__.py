"""From a Detection to a PadFix, and from fixes to a PadTrack. Pure."""
