"""Around a calibration: frames from files, what was found in words and pictures, and the files that are written."""
