"""Alight: lands a PX4 multirotor on a printed landmark."""
