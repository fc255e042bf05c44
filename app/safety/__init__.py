"""Monitors that turn inputs into verdicts. Pure."""
