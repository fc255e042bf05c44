"""Which exposure the next frames shall have, from what each frame says of the light. Pure: state in, state out.

Every reading is divided by the exposure that its own frame had: what is left is the light of the scene, which the
command doesn't change. So a command that takes effect late can't make it swing, however late. With the pad in sight
its white is brought to a set grey level; a pad so bright that its white saturates is read from its black. Without
the pad the picture's middle grey stands in for it, by the ratio that the two had: at first as it was when the pad was
last seen (it will still be in the picture), later as it was when the pad was last small in the picture. Where the
middle lies in the shade the pad may still lie in the sun: then nothing on the ground shall saturate, within bounds.
Exposure time comes before gain (less noise) up to the time in which the pad's image moves a set way; gain gives the
rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from app.config import ExposureConfig
from app.frames import Array
from app.landmark import Landmark
from app.messages import Detection, ExposureCommand, ExposureLimits, Frame, LightSource
from app.vision.camera_model import Lens
from app.vision.metering import SATURATED, HighlightMeter, PadLight, PadMeter, middle_grey

PAD_SHARE = 0.6
"""Of a pad's reading that a frame takes over (in stops), against its noise."""
PICTURE_SHARE = 0.35
"""Of a picture's: what lies under the camera changes more often than the daylight."""
STEP = 1.5
"""A reading that differs by more than this factor is a step of the light: it is taken over whole, at once."""
NOISE_GREY = 4.0
"""A grey level under this is noise, and light is read as if it were this."""
OVER = 4.0
"""How many times more than full scale the light is taken to be where all is saturated."""
RATIO = 14.0
"""White over black of a print in light, until the pad itself has told: matt black print reflects 4 to 6%."""
RATIO_SHARE = 0.1
HOLD_S = 0.5
"""A pad lost for longer is no longer in the picture."""
RELAX_S = 3.0
"""Its ratio to the picture then fades to the configured one with this time constant."""
HIGHLIGHT_MOST = 4.0
"""So many times brighter than by the middle grey the pad's white is taken to be, if something on the ground is."""
HIGHLIGHT_OVER = 1.5
"""How many times more than full scale the light of what saturates is taken to be."""
COVER_MAX = 0.3
"""A pad that covers less of the picture's middle leaves its median to the ground."""
MOTION_FADE_S = 0.65
"""The pad's motion in the image counts at once when it grows, and fades with this time constant when it shrinks."""
MOTION_GAP_S = 0.25
"""Between two detections farther apart than this no motion is read."""
MARGIN = 1.25
"""Black that needs lifting may lift white by so much in light: saturation is 1.5 to 1.6 away from the usual white."""


@dataclass(frozen=True, slots=True)
class ExposureState:
    """What is known of the light. Light is counted in full scales of the response per second at gain 1.

    Attributes:
        white_light: Of the pad's white; None before the first reading.
        pad_over_picture: Light of the pad's white over the picture's middle.
        pad_over_ground: The same when the pad was last so small that the middle was the ground's.
        white_over_black: Of the pad.
        t_pad_s: When the pad was last seen.
        t_s: Of the last frame that was read.
        centre_px: Where the pad was then.
        motion_px_s: How fast its image moves; None: not known.
        told: Exposure time and gain of the last command.
    """

    white_light: float | None = None
    pad_over_picture: float | None = None
    pad_over_ground: float | None = None
    white_over_black: float = RATIO
    t_pad_s: float = -math.inf
    t_s: float = -math.inf
    centre_px: Array | None = None
    motion_px_s: float | None = None
    told: tuple[float, float] | None = None


class ExposureSteering:
    """Steers one camera's exposure.

    Args:
        landmark: On the pad.
        lens: Of the camera.
        config: [exposure].
        exposure_max_s: Longest exposure that is wanted, motion or not.
    """

    def __init__(self, landmark: Landmark, lens: Lens, config: ExposureConfig, exposure_max_s: float) -> None:
        self._meter = PadMeter(landmark, lens)
        self._highlights = HighlightMeter(lens)
        self._config = config
        self._exposure_max_s = exposure_max_s

    def step(
        self, state: ExposureState, frame: Frame, detection: Detection, limits: ExposureLimits, now_s: float
    ) -> tuple[ExposureState, ExposureCommand | None]:
        """Take in a frame and the detection in it; what the camera is to be told, None if nothing new.

        A frame whose exposure isn't known says nothing; where none has been told yet, a first one is.
        """
        if frame.exposure_s is None or frame.gain is None or frame.exposure_s <= 0.0 or frame.gain <= 0.0:
            if state.told is not None:
                return state, None
            exposure_s = min(self._exposure_max_s, math.sqrt(limits.exposure_min_s * limits.exposure_max_s))
            first = ExposureCommand(now_s, frame.sequence, exposure_s, limits.gain_min, LightSource.START)
            return replace(state, told=(first.exposure_s, first.gain)), first
        pad = self._meter.read(frame, detection) if detection.detected else None
        picture = middle_grey(frame.image)
        total = frame.exposure_s * frame.gain
        picture_light = self._light(picture) * (OVER if picture >= SATURATED else 1.0) / total
        if pad is not None:
            state = self._see_pad(state, pad, picture, picture_light, total, frame.t_capture_s)
        else:
            state = self._see_picture(state, picture_light, frame, total)
        exposure_s, gain = self._split(state, limits)
        if not self._is_news(state, exposure_s, gain):
            return state, None
        command = ExposureCommand(
            now_s,
            frame.sequence,
            exposure_s,
            gain,
            LightSource.PICTURE if pad is None else LightSource.PAD,
            None if pad is None else pad.white,
            None if pad is None else pad.black,
            0.0 if pad is None else pad.saturated,
            picture,
            state.motion_px_s,
        )
        return replace(state, told=(exposure_s, gain)), command

    # ------------------------------------------------------------------------------------------------------ what is lit
    def _light(self, grey: float) -> float:
        """Light of a grey level, of full scale."""
        return float((max(NOISE_GREY, grey) / 255.0) ** self._config.response_gamma)

    def _see_pad(
        self, state: ExposureState, pad: PadLight, picture: float, picture_light: float, total: float, t_s: float
    ) -> ExposureState:
        ratio = state.white_over_black
        black_light = self._light(pad.black) / total
        if pad.white < SATURATED:
            white_light = self._light(pad.white) / total
            if pad.black > 2.0 * NOISE_GREY and pad.white > pad.black:
                ratio *= (white_light / black_light / ratio) ** RATIO_SHARE
        elif pad.black < SATURATED:
            white_light = max(self._light(SATURATED) / total, ratio * black_light)
        else:
            white_light = OVER * self._light(SATURATED) / total
        over, ground = state.pad_over_picture, state.pad_over_ground
        if pad.white < SATURATED and NOISE_GREY < picture < SATURATED:
            over = white_light / picture_light
            ground = over if pad.cover < COVER_MAX else ground
        return replace(
            state,
            white_light=_towards(state.white_light, white_light, PAD_SHARE),
            pad_over_picture=over,
            pad_over_ground=ground,
            white_over_black=ratio,
            t_pad_s=t_s,
            t_s=t_s,
            centre_px=pad.centre_px,
            motion_px_s=motion_px_s(state, pad.centre_px, t_s),
        )

    def _see_picture(self, state: ExposureState, picture_light: float, frame: Frame, total: float) -> ExposureState:
        t_s = frame.t_capture_s
        usual = self._light(self._config.white_level) / self._light(self._config.picture_level)
        ground = usual if state.pad_over_ground is None else state.pad_over_ground
        lost_s = t_s - state.t_pad_s
        if lost_s <= HOLD_S and state.pad_over_picture is not None:
            white_light = state.pad_over_picture * picture_light
        else:
            ground *= (usual / ground) ** min(1.0, max(0.0, t_s - state.t_s) / RELAX_S)
            highlight = self._highlights.read(frame.image)
            brightest = self._light(highlight) * (HIGHLIGHT_OVER if highlight >= SATURATED else 1.0) / total
            white_light = ground * picture_light
            white_light = min(max(white_light, brightest), HIGHLIGHT_MOST * white_light)
        return replace(
            state,
            white_light=_towards(state.white_light, white_light, PICTURE_SHARE),
            pad_over_ground=ground,
            t_s=t_s,
            motion_px_s=state.motion_px_s if lost_s <= HOLD_S else None,
        )

    # -------------------------------------------------------------------------------------------------- what is wanted
    def _split(self, state: ExposureState, limits: ExposureLimits) -> tuple[float, float]:
        """Exposure time and gain for the light that is known."""
        config = self._config
        assert state.white_light is not None
        wanted = self._light(config.white_level)
        black = wanted / state.white_over_black
        if black < self._light(config.black_level):
            wanted *= min(MARGIN, self._light(config.black_level) / black)
        total = wanted / state.white_light
        longest_s = min(limits.exposure_max_s, self._exposure_max_s)
        if state.motion_px_s is not None:
            longest_s = min(longest_s, config.blur_max_px / max(state.motion_px_s, 1e-3))
        longest_s = max(longest_s, limits.exposure_min_s)
        exposure_s = min(longest_s, max(limits.exposure_min_s, total / limits.gain_min))
        gain = min(config.gain_max, limits.gain_max, max(limits.gain_min, total / exposure_s))
        return exposure_s, max(limits.gain_min, gain)

    def _is_news(self, state: ExposureState, exposure_s: float, gain: float) -> bool:
        """Whether it is far enough from the last command to be told."""
        if state.told is None:
            return True
        band = math.log1p(self._config.dead_band)
        told_s, told_gain = state.told
        brighter = abs(math.log(exposure_s * gain / (told_s * told_gain)))
        # A little more blur is worth no command, a little more light is.
        return brighter > band or abs(math.log(exposure_s / told_s)) > 3.0 * band


def _towards(old: float | None, new: float, share: float) -> float:
    """A share of the way from old to new, in stops; all of it, if that is a step."""
    if old is None or not old / STEP < new < old * STEP:
        return new
    return old * math.pow(new / old, share)


def motion_px_s(state: ExposureState, centre_px: Array, t_s: float) -> float | None:
    """How fast the pad's image moves, px/s: at once when it grows, fading when it shrinks."""
    gap_s = t_s - state.t_pad_s
    if state.centre_px is None or gap_s <= 0.0:
        return state.motion_px_s
    faded = None if state.motion_px_s is None else state.motion_px_s * math.exp(-gap_s / MOTION_FADE_S)
    if gap_s >= MOTION_GAP_S:
        return faded
    moved = float(np.linalg.norm(centre_px - state.centre_px)) / gap_s
    return moved if faded is None else max(moved, faded)
