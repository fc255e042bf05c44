"""What a pad falls short of, in words, and what would do instead. Each advice was tried: with it, a pad is found.

Only one thing is changed at a time; where no single change is enough, that is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

from app.errors import ConfigError
from app.review.pad_design.proposal import HEADROOM, Design, Request, can_be_met
from app.review.pad_design.view import WIDEST_RAD, View

HALVINGS = 12
"""Of the range of a quantity, in search of the least change of it that does."""
LARGEST_M = 20.0
"""Largest pad that pad files describe."""
FINEST_M = 0.0003
"""Finer lines than this are lost to any printer."""
SHARPEST = 8.0
"""Times the pixels of the camera that is there."""
Ways = tuple[View, Request]


def shortfalls(design: Design) -> tuple[str, ...]:
    """What it doesn't do of what was asked for, a sentence each; none if it is met."""
    request, (low, high) = design.request, design.spans[0]
    size = f"{design.landmark.size_m * 100:.4g} cm"
    found: list[str] = []
    if not design.reaches_ceiling:
        px = design.view.scale_px * design.landmark.size_m / request.ceiling_m
        found.append(
            f"the ceiling of {request.ceiling_m:g} m is out of reach: a pad of {size} is seen up to {high:.2f} m; at "
            f"{request.ceiling_m:g} m its side is {px:.1f} px, under {request.min_side_px:g} px"
        )
    if not design.reaches_floor:
        found.append(
            f"the floor of {request.floor_m:g} m is out of reach: under {low:.3f} m no part of a pad of {size} that "
            "settles its place and heading is whole in view"
        )
    if not design.is_printable:
        found.append(
            f"its finest line is {design.pad.detail_m * 1000:.2f} mm, under the {request.detail_m * 1000:g} mm that "
            "can be printed"
        )
    return tuple(found)


def remedies(design: Design, view_at: Callable[[float, float], View]) -> tuple[str, ...]:
    """Single changes after which some pad does what is asked for, the least change of each; none if it is met.

    Args:
        design: The pad that came nearest.
        view_at: The camera's view for a tilt (radians) and an offset (part of the view).
    """
    if design.is_met:
        return ()
    found = tuple(_remedies(design.view, design.request, view_at))
    return found or ("no single change is enough: change more than one of size, camera, ceiling and floor",)


def _remedies(view: View, request: Request, view_at: Callable[[float, float], View]) -> Iterator[str]:
    size = _least(lambda m: (view, replace(request, max_size_m=m)), request.max_size_m, LARGEST_M)
    if size is not None:
        yield f"a larger pad: --max-size-cm {_up(size * 100):g}"
    ceiling = _least(lambda m: (view, replace(request, ceiling_m=m)), request.ceiling_m, request.floor_m * HEADROOM)
    if ceiling is not None:
        yield f"a lower ceiling: --ceiling {_down(ceiling):g}"
    floor = _least(lambda m: (view, replace(request, floor_m=m)), request.floor_m, request.ceiling_m / HEADROOM)
    if floor is not None:
        yield f"a higher floor: --floor {_up(floor):g}"
    detail = _least(lambda m: (view, replace(request, detail_m=m)), request.detail_m, FINEST_M)
    if detail is not None:
        yield f"a finer print: --detail-mm {_down(detail * 1000):g}"
    if view.tilt_rad > 0.0:
        tilt = _least(lambda rad: (view_at(rad, view.offset), request), view.tilt_rad, 0.0)
        if tilt is not None:
            yield f"less tilt to allow for: --tilt {_down(math.degrees(tilt)):g}"
    if view.offset > 0.0:
        offset = _least(lambda part: (view_at(view.tilt_rad, part), request), view.offset, 0.0)
        if offset is not None:
            yield f"a pad nearer to the middle of the view: --offset {_down(offset):g}"
    times = _least(lambda k: (replace(view, scale_px=view.scale_px * k), request), 1.0, SHARPEST)
    if times is not None:
        yield f"a camera with {_up(times):g} times the pixels across the same view"
    widest = WIDEST_RAD + view.tilt_rad
    angle = _least(lambda rad: (replace(view, half_angle_rad=rad), request), view.half_angle_rad, widest)
    if angle is not None:
        yield (
            f"a wider lens with as many pixels to a degree: {_up(math.degrees(angle)):g} deg to each side instead of "
            f"{math.degrees(view.half_angle_rad):.3g}"
        )


def _least(changed: Callable[[float], Ways], start: float, end: float) -> float | None:
    """The value nearest to `start`, on the way to `end`, with which a request can be met; None if `end` won't do.

    Halving finds it, since more of any of these changes never does less.
    """
    try:
        if not can_be_met(*changed(end)):
            return None
    except ConfigError:
        return None
    bad, good = start, end
    for _ in range(HALVINGS):
        middle = 0.5 * (bad + good)
        if can_be_met(*changed(middle)):
            good = middle
        else:
            bad = middle
    return good


def _digits(value: float) -> float:
    """A step of two digits of a value."""
    return 10.0 ** (math.floor(math.log10(max(abs(value), 1e-9))) - 1)


def _up(value: float) -> float:
    """Rounded up to two digits."""
    return round(math.ceil(value / _digits(value) - 1e-9) * _digits(value), 9)


def _down(value: float) -> float:
    """Rounded down to two digits."""
    return round(math.floor(value / _digits(value) + 1e-9) * _digits(value), 9)
