"""The mission state machine. Pure."""
