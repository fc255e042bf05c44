"""Drivers of the Autopilot port."""
