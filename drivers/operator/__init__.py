"""Drivers of the OperatorLink port, and the phone that speaks to it."""
