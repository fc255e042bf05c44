"""Designs a pad for a camera and a range of heights: its size, how many contours, and which of them are seen when.

`view` says what a camera sees of a flat pad under it, `runs` which parts of a landmark can be told from each other and
from how high each is seen, `patterns` lists the landmarks to choose from, `proposal` chooses, `advice` finds what would
do where none does; `words`, `pad_file` and `picture` tell it to a person. All but the last two are pure.
It owns no geometry of contours (app.landmark) and no lens formula (app.vision.camera_model).
"""
