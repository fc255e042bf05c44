"""The dynamic threshold: which grey level binarises the next frame. A pure state machine, one step a frame.

After a success the next level is Otsu's on the region round the landmark, taken if it lies within a set band of the
whole frame's, else the whole frame's. Misses keep it for a while; then a sweep tries a range in fixed steps, one step a
frame; after fruitless sweeps a wider range with a finer step; then the landmark is completely lost and all starts
afresh, from Otsu's level of the whole frame. Source: Wu et al., section II (the dynamic threshold and its three levels
of search).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

from app.config import VisionConfig


class Search(StrEnum):
    """How hard it looks."""

    FRESH = "fresh"
    """Nothing known: Otsu's level of each frame."""
    TRACK = "track"
    """The level of the last success, in the region round it."""
    SWEEP = "sweep"
    """Level 2: a range in fixed steps."""
    WIDE = "wide"
    """Level 3: a wider range with a finer step."""


@dataclass(frozen=True, slots=True)
class ThresholdState:
    """Where the search stands.

    Attributes:
        search: Its level.
        level: Grey level of the last success (TRACK); 0 else.
        misses: Frames without the landmark since the level of search began.
        sweeps: Sweeps of this range that ended without a success.
        times_lost: How often it was completely lost.
    """

    search: Search = Search.FRESH
    level: int = 0
    misses: int = 0
    sweeps: int = 0
    times_lost: int = 0


def ladder(first: int, last: int, step: int) -> tuple[int, ...]:
    """Levels of one sweep, both ends included; a range given backwards is swept downwards."""
    direction = step if last >= first else -step
    levels = list(range(first, last + (1 if direction > 0 else -1), direction))
    return (*levels, last) if levels[-1] != last else tuple(levels)


def sweep_levels(search: Search, config: VisionConfig) -> tuple[int, ...]:
    """Levels of a sweep of this kind; none for the others."""
    if search is Search.SWEEP:
        return ladder(config.sweep_from, config.sweep_to, config.sweep_step)
    if search is Search.WIDE:
        return ladder(config.wide_from, config.wide_to, config.wide_step)
    return ()


def threshold_now(state: ThresholdState, config: VisionConfig, global_level: int) -> int:
    """Grey level for this frame; global_level is Otsu's of the whole frame, used while nothing is known."""
    if state.search is Search.TRACK:
        return state.level
    levels = sweep_levels(state.search, config)
    return levels[state.misses % len(levels)] if levels else global_level


def after_success(state: ThresholdState, config: VisionConfig, roi_level: int, global_level: int) -> ThresholdState:
    """The state after a frame with the landmark, from Otsu's levels of the region round it and of the whole frame."""
    near = abs(roi_level - global_level) <= config.otsu_band
    return ThresholdState(Search.TRACK, roi_level if near else global_level, times_lost=state.times_lost)


def after_miss(state: ThresholdState, config: VisionConfig) -> ThresholdState:
    """The state after a frame without it."""
    misses = state.misses + 1
    if state.search in (Search.FRESH, Search.TRACK):
        if misses <= config.misses_before_sweep:
            return replace(state, misses=misses)
        return ThresholdState(Search.SWEEP, times_lost=state.times_lost)
    if misses < len(sweep_levels(state.search, config)):
        return replace(state, misses=misses)
    sweeps = state.sweeps + 1
    if state.search is Search.SWEEP:
        if sweeps < config.sweeps_before_wide:
            return replace(state, misses=0, sweeps=sweeps)
        return ThresholdState(Search.WIDE, times_lost=state.times_lost)
    if sweeps < config.wide_sweeps_before_lost:
        return replace(state, misses=0, sweeps=sweeps)
    return ThresholdState(Search.FRESH, times_lost=state.times_lost + 1)
