"""Calibration: boards and landmarks in known places to a camera file or a height table. Pure mathematics; reading,
drawing and writing files are app.review.calibration's.
"""
