"""Draws the landmark to files at true size: PDF, SVG and PNG, whole or cut into printer pages.

`sheet` lays the landmark out on one sheet, `tiles` cuts a sheet into pages, and each writer turns pages into files.
It owns no geometry of the landmark: that is app.landmark's.
"""

from app.review.printing.draw import draw_landmark

__all__ = ["draw_landmark"]
