"""Drivers of the Recorder port."""
