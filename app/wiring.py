"""From a configuration to drivers, queues and tasks. The only file in app/ that imports drivers."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2

from app.clock import MonotonicClock
from app.config import CameraConfig, LensConfig, PadConfig, RigConfig, VisionConfig, WorldConfig, read_config, resolve
from app.errors import ConfigError, OperatorError
from app.estimation.fix import FixMaker, Method, pose_estimator
from app.estimation.height_table import HeightTable, outer_triangle, read_height_table
from app.estimation.mount import body_from_cam
from app.landmark import Landmark, paper_landmark
from app.ports import Autopilot, Camera, OperatorLink
from app.review.inspect import InspectedFrame, inspect
from app.runtime import Application, Parts
from app.tasks.compute import InThread
from app.vision.camera_model import Lens, lens_from_config
from app.vision.detector import Detector
from app.vision.exposure import ExposureSteering
from drivers.autopilot.px4_mavsdk import Px4Autopilot
from drivers.autopilot.px4_param_file import ParameterCheck, read_wanted
from drivers.camera.images import open_sources
from drivers.camera.opencv import OpenCvCamera
from drivers.camera.picamera import PiCamera
from drivers.camera.synthetic import SyntheticCamera
from drivers.mavsdk_session import check_address
from drivers.operator.mavlink import MavlinkOperator
from drivers.operator.phone import PhoneEvent, PhoneProgress, PhoneResult, PhoneText, Wanted, send_command
from drivers.recorder.mcap import McapRecorder
from drivers.simulator.launcher import SimulatorProcess

__all__ = [
    "CONFIGS",
    "PhoneEvent",
    "PhoneProgress",
    "PhoneResult",
    "PhoneText",
    "Rig",
    "SimulatorProcess",
    "Wanted",
    "build_application",
    "build_simulator",
    "check_operator",
    "inspect_files",
    "load_rig",
    "load_shipped_rig",
    "make_camera",
    "make_exposure",
    "make_links",
    "open_camera",
    "open_sources",
    "parameter_check",
    "read_landmark",
    "read_lens",
    "tell",
]

CONFIGS = Path(__file__).resolve().parent.parent / "configs"
"""The configurations that ship."""
PARAMETERS = "deploy/px4/alight.params"
PARAMETERS_ON_TOP = ("deploy/px4/alight-moving-pad.params",)
"""PX4's parameters that ship, and those that may be loaded on top of them."""


@dataclass(frozen=True, slots=True)
class Rig:
    """A rig file and the files that it names, read and checked.

    Attributes:
        path: Of the rig file.
        config: What it says.
        landmark: Of its pad.
        lens_config: Of its camera.
        lens: The model of that.
        height_table: For method paper; None: worked out from the lens.
    """

    path: Path
    config: RigConfig
    landmark: Landmark
    lens_config: LensConfig
    lens: Lens
    height_table: HeightTable | None = None

    def with_world(self, world: WorldConfig) -> Rig:
        """The same in another simulated world."""
        return replace(self, config=self.config.model_copy(update={"simulator": world}))

    def on_free_ports(self) -> Rig:
        """The same with both links on free UDP ports of this machine: beside a PX4 SITL or another simulator."""
        with socket.socket(type=socket.SOCK_DGRAM) as one, socket.socket(type=socket.SOCK_DGRAM) as two:
            one.bind(("127.0.0.1", 0))
            two.bind(("127.0.0.1", 0))
            addresses = [f"udpin://127.0.0.1:{free.getsockname()[1]}" for free in (one, two)]
        autopilot = self.config.autopilot.model_copy(update={"address": addresses[0]})
        operator = self.config.operator.model_copy(update={"address": addresses[1]})
        return replace(self, config=self.config.model_copy(update={"autopilot": autopilot, "operator": operator}))


def read_lens(path: Path) -> LensConfig:
    """A camera file.

    Raises:
        ConfigError: It is missing or wrong.
    """
    return read_config(path, LensConfig)


def read_landmark(path: Path | None, size_cm: float | None = None) -> Landmark:
    """A pad file's landmark, or the paper's; at its own size or another.

    Raises:
        ConfigError: The file is missing or wrong.
        LandmarkError: It can't be drawn.
    """
    if path is None:
        return paper_landmark(0.38 if size_cm is None else size_cm / 100.0)
    return read_config(path, PadConfig).landmark(size_cm)


def load_rig(path: Path) -> Rig:
    """A rig file with everything that it names.

    Raises:
        ConfigError: A file is missing or wrong.
        LandmarkError: The pad can't be drawn.
    """
    config = read_config(path, RigConfig)
    lens_config = read_lens(_named(path, "camera.lens", config.camera.lens))
    landmark = read_landmark(_named(path, "pad", config.pad))
    table = None
    if config.vision.height_table:
        table = read_height_table(_named(path, "vision.height_table", config.vision.height_table))
    if config.vision.method == "paper" and outer_triangle(landmark) is None:
        raise ConfigError(
            f'{path}: vision.method = "paper" takes the heading from a triangle, and pad {landmark.name} has none',
            'set vision.method = "pnp", or name a pad with a triangle',
        )
    return Rig(path, config, landmark, lens_config, lens_from_config(lens_config), table)


def load_shipped_rig(name: str) -> Rig:
    """A rig of configs/.

    Raises:
        ConfigError: The configurations that ship are not here.
    """
    path = CONFIGS / name
    if not path.is_file():
        raise ConfigError(f"{path}: Alight's own configurations are not here", "run Alight from its project folder")
    return load_rig(path)


def _named(path: Path, key: str, name: str) -> Path:
    """The file that a key of a rig file names.

    Raises:
        ConfigError: There is none.
    """
    named = resolve(path, name)
    if not named.is_file():
        raise ConfigError(f"{path}: {key} = {name!r}: no such file ({named})", "give a path relative to the rig file")
    return named


def make_camera(rig: Rig, source: str | None = None) -> Camera:
    """The rig's camera; `source` replaces the configured one."""
    camera = rig.config.camera if source is None else rig.config.camera.model_copy(update={"source": source})
    size = (rig.lens_config.width_px, rig.lens_config.height_px)
    match camera.driver:
        case "picamera2":
            return PiCamera(camera, size)
        case "opencv":
            return OpenCvCamera(camera, size)
        case "synthetic":
            return SyntheticCamera(camera.source)


def make_exposure(rig: Rig) -> ExposureSteering | None:
    """What steers the camera's exposure; None if the rig leaves that to the camera."""
    if not rig.config.exposure.steer:
        return None
    return ExposureSteering(
        rig.landmark, rig.lens, rig.config.exposure, exposure_max_s=rig.config.camera.exposure_max_ms / 1e3
    )


def open_camera(what: str) -> Camera:
    """A camera to calibrate: that of a rig file, or the device number or URL that OpenCV opens, as it comes.

    Raises:
        ConfigError: The rig file is wrong.
    """
    if what.endswith(".toml"):
        return make_camera(load_rig(Path(what)))
    return OpenCvCamera(CameraConfig(driver="opencv", lens="", source=what))


def make_links(rig: Rig) -> tuple[Autopilot, OperatorLink]:
    """The rig's autopilot and the phone, neither open yet; the phone's is opened after the autopilot's.

    Raises:
        ConfigError: PX4's parameters that ship are not here.
    """
    autopilot = Px4Autopilot(rig.config.autopilot, parameter_check(rig))
    return autopilot, MavlinkOperator(rig.config.operator, autopilot)


def parameter_check(rig: Rig) -> ParameterCheck | None:
    """What PX4's failsafe parameters are compared with; None if the rig switches that off.

    Raises:
        ConfigError: The parameters that ship are not here.
    """
    wanted = rig.config.autopilot.check_parameters
    if wanted == "off":
        return None
    project = CONFIGS.parent
    parameters = read_wanted(project / PARAMETERS, *(project / name for name in PARAMETERS_ON_TOP))
    return ParameterCheck(PARAMETERS, parameters, rig.config.safety, must_match=wanted == "refuse")


def check_operator(rig: Rig) -> None:
    """See that the phone's own address can be listened on.

    Raises:
        OperatorError: It can't.
    """
    check_address(rig.config.operator.address, OperatorError)


def build_application(rig: Rig, *, source: str | None = None, record: Path | None = None) -> Application:
    """The application for a rig, ready to run.

    Args:
        rig: What it is made of.
        source: Replaces the camera's configured source.
        record: Flight record to write; None for none.
    """
    config = rig.config
    cv2.setNumThreads(1)  # one thread of vision's own; the other cores belong to the rest
    autopilot, operator = make_links(rig)
    recorder = None
    if record is not None:
        recorder = McapRecorder(
            record, jpeg_quality=config.recorder.jpeg_quality, frame_rate_hz=config.recorder.frame_rate_hz
        )
    parts = Parts(
        config=config,
        camera=lambda: make_camera(rig, source),
        autopilot=autopilot,
        operator=operator,
        recorder=recorder,
        detector=Detector(rig.landmark, rig.lens, config.vision),
        make_fix=FixMaker(
            pose_estimator(rig.landmark, rig.lens, config.vision.method, rig.height_table), body_from_cam(config.camera)
        ),
        clock=MonotonicClock(),
        compute=InThread(),
        exposure=make_exposure(rig),
    )
    return Application(parts)


def build_simulator(rig: Rig, *, frames: Path, truth: Path | None) -> SimulatorProcess:
    """The simulator for a rig with a [simulator] table.

    Raises:
        ConfigError: It has none.
    """
    if rig.config.simulator is None:
        raise ConfigError(f"{rig.path}: camera.driver is synthetic and there is no [simulator]", "add that table")
    companion = rig.config.autopilot.address.rpartition("//")[2]
    config = rig.config
    return SimulatorProcess(rig.path, frames, truth, world=config.simulator, camera=config.camera, companion=companion)


def tell(address: str, wanted: Wanted, silence_s: float) -> Iterator[PhoneEvent]:
    """Give an order as the phone, and what comes back; silence_s is the longest silence to wait through.

    Raises:
        OperatorError: Nobody answers.
    """
    return send_command(address, wanted, timeout_s=silence_s)


def inspect_files(
    paths: Sequence[Path],
    *,
    camera: Path,
    pad: Path | None,
    method: Method,
    sequence: bool | None,
    draw: Path | None,
) -> Iterator[InspectedFrame]:
    """Look for a landmark in images, folders and videos.

    Args:
        paths: What to look at.
        camera: Camera file.
        pad: Pad file; None for the paper's landmark.
        method: How the pose is worked out.
        sequence: Threshold and region carry over; None: for videos only.
        draw: Folder for pictures of what was seen.

    Raises:
        AlightError: A file is missing, wrong, or not what it should be.
    """
    cv2.setNumThreads(1)
    lens = lens_from_config(read_lens(camera))
    landmark = read_landmark(pad)
    return inspect(
        open_sources(paths),
        lens=lens,
        landmark=landmark,
        vision=VisionConfig(),
        method=method,
        sequence=sequence,
        draw=draw,
    )
