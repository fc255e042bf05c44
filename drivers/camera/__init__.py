"""Drivers of the Camera port."""
