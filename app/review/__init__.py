"""What is done after a flight: figures, video, report."""
