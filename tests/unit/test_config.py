"""Configuration files: those that ship can be read, and each wrong one is refused in words that help to mend it."""

import re
from pathlib import Path

import pytest

from app.config import LensConfig, PadConfig, RigConfig, read_config, resolve
from app.errors import ConfigError, LandmarkError
from app.wiring import load_rig

CONFIGS = Path(__file__).parents[2] / "configs"
RIG = """
pad = "pads/paper-38cm.toml"
[camera]
driver = "opencv"
lens = "cameras/pi-fisheye-640.toml"
source = "0"
"""
PAD = """
name = "mine"
size_cm = 38.0
[[contour]]
shape = "square"
area_ratio = 1.0
[[contour]]
shape = "square"
area_ratio = 0.5
"""
LENS = """
model = "equidistant"
width_px = 640
height_px = 480
fx_px = 215.0
fy_px = 215.0
cx_px = 319.5
cy_px = 239.5
"""


@pytest.fixture
def write(tmp_path):
    def write_file(text: str) -> Path:
        path = tmp_path / "mine.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write_file


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.name)
def test_rig_file_that_ships_is_read_and_names_files_that_are(path):
    rig = read_config(path, RigConfig)
    read_config(resolve(path, rig.camera.lens), LensConfig)
    read_config(resolve(path, rig.pad), PadConfig).landmark()


@pytest.mark.parametrize("path", sorted((CONFIGS / "cameras").glob("*.toml")), ids=lambda path: path.name)
def test_camera_file_that_ships_is_read(path):
    lens = read_config(path, LensConfig)
    assert (lens.width_px, lens.height_px) == (640, 480)


@pytest.mark.parametrize(
    ("name", "size_m", "zone_m", "code"),
    [
        ("paper-38cm", 0.38, 0.46, "44334"),
        ("paper-100cm", 1.0, 1.21, "44334"),
        ("a4-17cm", 0.17, 0.19, "44334"),
        ("nested-7-100cm", 1.0, 1.21, "4433434"),
    ],
)
def test_pad_file_that_ships_is_drawn_as_its_name_says(name, size_m, zone_m, code):
    landmark = read_config(CONFIGS / "pads" / f"{name}.toml", PadConfig).landmark()
    assert (landmark.name, landmark.code) == (name, code)
    assert (landmark.size_m, landmark.quiet_zone_m) == pytest.approx((size_m, zone_m))


def test_every_pad_that_ships_is_one_of_those_tested():
    assert {path.stem for path in (CONFIGS / "pads").glob("*.toml")} == {
        "paper-38cm",
        "paper-100cm",
        "a4-17cm",
        "nested-7-100cm",
    }


def test_pad_at_another_size_scales_quiet_zone_and_offsets(write):
    pad = read_config(write(PAD.replace("38.0", "40.0\nquiet_zone_cm = 50.0") + "offset_forward_cm = 2.0\n"), PadConfig)
    landmark = pad.landmark(size_cm=20.0)
    assert (landmark.size_m, landmark.quiet_zone_m) == pytest.approx((0.2, 0.25))
    assert landmark.contours[1].centroid_m == pytest.approx([0.01, 0.0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "[guidance]\ndescent_speed_m_s = 0.8",
            ["guidance.descent_speed_m_s", "0.8", "did you mean descend_speed_m_s"],
        ),
        ("[guidance]\ndescend_speed_cm_s = 80", ["descend_speed_cm_s", "did you mean descend_speed_m_s", "units"]),
        ("[guidance]\nspeed_max_km_h = 20", ["speed_max_km_h", "did you mean speed_max_m_s", "units"]),
        ("[mission]\nhover_height_ft = 8", ["hover_height_ft", "did you mean hover_height_m", "units"]),
        ("[guidence]\nalign_yaw = true", ["guidence", "did you mean guidance"]),
        ("[safety]\nzzz = 1", ["safety.zzz", "known here", "track_stale_s"]),
        ("[guidance]\ntouchdown_speed_m_s = 9.0", ["guidance.touchdown_speed_m_s = 9.0", "less than or equal to 1"]),
        ("[guidance]\ntouchdown_speed_m_s = 'fast'", ["guidance.touchdown_speed_m_s = 'fast'", "must be a number"]),
        ("[mission]\nsearch_height_m = nan", ["mission.search_height_m = nan", "finite"]),
        ("[mission]\nlanding_tries = 2.5", ["mission.landing_tries = 2.5", "integer"]),
        ("[autopilot]\naddress = '127.0.0.1:14540'", ["autopilot.address = '127.0.0.1:14540'", "udpin"]),
        ("[guidance]\nmethod = 'px4'", ["guidance.method = 'px4'", "'velocity' or 'px4-precland'"]),
        ("[vision]\nmethod = 'guess'", ["vision.method = 'guess'", "'pnp' or 'paper'"]),
        ("[mission]\nsearch_height_m = true", ["mission.search_height_m = True", "must be a number"]),
        ("[mission]\nlanding_tries = true", ["mission.landing_tries = True", "must be a number"]),
        ("[mission]\nsearch_height_m = '5'", ["mission.search_height_m = '5'", "must be a number"]),
        ("[guidance]\nsearch_spacing_m = 0.001", ["guidance.search_spacing_m = 0.001", "greater than or equal to 0.3"]),
        (
            "[mission]\nsearch_height_m = 40.0\ntrack_height_m = 30.0",
            ["mission.search_height_m = 40 must be under safety.height_max_m = 30", "mission.track_height_m = 30"],
        ),
        (
            "[guidance]\ncommit_height_m = 3.0",
            ["guidance.commit_height_m = 3 must be under mission.track_height_m = 2.5", "guidance.cone_height_m = 3"],
        ),
        ("[guidance]\ncone_radius_m = 0.05", ["touchdown_radius_m = 0.1 must be under guidance.cone_radius_m = 0.05"]),
        ("[guidance]\nsearch_radius_m = 300", ["under safety.distance_from_home_max_m = 300"]),
        ("[safety]\nframes_stale_s = 0.06", ["two frames of the camera, s = 0.0666667", "frames_stale_s = 0.06"]),
    ],
)
def test_rig_file_with_one_fault_is_refused_in_words_that_help(write, text, words):
    path = write(RIG + text)
    with pytest.raises(ConfigError) as refused:
        read_config(path, RigConfig)
    message = str(refused.value)
    assert [word for word in (str(path), *words) if word not in message] == []
    assert "\n" not in message


@pytest.mark.parametrize(
    ("world", "driver", "refused"),
    [("px4", "synthetic", False), ("built-in", "synthetic", True), ("built-in", "picamera2", False)],
)
def test_px4s_precision_landing_is_refused_where_no_px4_flies(write, world, driver, refused):
    rig = RIG.replace('driver = "opencv"', f'driver = "{driver}"')
    assert f'"{driver}"' in rig
    path = write(f'{rig}[guidance]\nmethod = "px4-precland"\n[simulator]\nvehicle = "{world}"\n')
    if not refused:
        assert read_config(path, RigConfig).guidance.method == "px4-precland"
        return
    with pytest.raises(ConfigError, match='"px4-precland" needs a PX4: the built-in simulator has no precision'):
        read_config(path, RigConfig)


def test_rig_file_with_several_faults_names_them_all_at_once(write):
    text = RIG.replace('driver = "opencv"', "") + "[safety]\ntilt_max_deg = 200\n[mission]\nlanding_trys = 1\n"
    with pytest.raises(ConfigError) as refused:
        read_config(write(text), RigConfig)
    wanted = ("camera.driver is missing", "safety.tilt_max_deg = 200", "did you mean landing_tries")
    assert [word for word in wanted if word not in str(refused.value)] == []


def test_rig_file_with_many_faults_counts_those_it_leaves_out(write):
    with pytest.raises(ConfigError, match=r"and 2 more"):
        read_config(write(RIG + "[safety]\n" + "\n".join(f"wrong_{k} = {k}" for k in range(6))), RigConfig)


def test_config_that_is_missing_names_the_path_and_the_nearest_file():
    with pytest.raises(ConfigError, match=r"simulatr\.toml: no such file; did you mean .*simulator\.toml"):
        read_config(CONFIGS / "simulatr.toml", RigConfig)


def test_config_that_is_missing_with_nothing_like_it_says_what_to_give(tmp_path):
    with pytest.raises(ConfigError, match=r"x\.toml: no such file; give the path of a \.toml file"):
        read_config(tmp_path / "x.toml", RigConfig)


def test_config_that_is_no_toml_names_the_line(write):
    with pytest.raises(ConfigError, match=r"mine\.toml: not valid TOML: .*line 2"):
        read_config(write("pad = 1\n[camera\n"), RigConfig)


def test_config_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match=r"x\.toml: can't be read"):
        read_config(tmp_path / "x.toml", RigConfig)


def test_config_that_is_a_folder_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="can't be read"):
        read_config(tmp_path, RigConfig)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PAD.replace("size_cm = 38.0", "size_mm = 380"), ["size_mm = 380", "did you mean size_cm", "units"]),
        (PAD.replace("area_ratio = 0.5", "area_ratio = 32"), ["contour.1.area_ratio = 32", "less than or equal to 1"]),
        (PAD.replace('shape = "square"', 'shape = "circle"', 1), ["contour.0.shape = 'circle'", "square", "triangle"]),
        (PAD + "ofset_forward_cm = 1", ["contour.1.ofset_forward_cm", "did you mean offset_forward_cm"]),
        (PAD.split("[[contour]]")[0], ["contour is missing"]),
    ],
)
def test_pad_file_with_a_fault_is_refused_in_words_that_help(write, text, words):
    with pytest.raises(ConfigError) as refused:
        read_config(write(text), PadConfig)
    assert [word for word in words if word not in str(refused.value)] == []


def test_pad_file_that_cannot_be_drawn_is_a_landmark_error(write):
    with pytest.raises(LandmarkError, match=r"'mine': S2 in S1 leaves a gap of 0\.95 mm"):
        # Sides 38 and 37.8095 cm: (1 - sqrt(0.99)) * 19 cm = 0.0952 cm.
        read_config(write(PAD.replace("area_ratio = 0.5", "area_ratio = 0.99")), PadConfig).landmark()


@pytest.mark.parametrize(
    ("model", "coefficients", "allowed"),
    [("pinhole", "[0.1, 0.2]", "0 or 4 or 5"), ("equidistant", "[0.1, 0.2, 0.0, 0.0, 0.0]", "0 or 4")],
)
def test_camera_file_with_the_wrong_number_of_coefficients_says_how_many(write, model, coefficients, allowed):
    text = LENS.replace("equidistant", model) + f"distortion = {coefficients}\n"
    with pytest.raises(ConfigError, match=f"a {model} lens takes {allowed} distortion coefficients"):
        read_config(write(text), LensConfig)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("cx_px = 319.5", "cx_px = 5000.0", "axis at cx_px, cy_px = 5000, 239.5 lies outside of the image of 640x480"),
        ("cy_px = 239.5", "cy_px = -300.0", "axis at cx_px, cy_px = 319.5, -300 lies outside of the image"),
        ("fx_px = 215.0", "fx_px = 0.001", "fx_px, fy_px = 0.001, 215 are not within 64..12800 pixels"),
    ],
)
def test_camera_file_of_no_lens_is_refused(write, old, new, words):
    with pytest.raises(ConfigError, match=re.escape(words)):
        read_config(write(LENS.replace(old, new)), LensConfig)


def test_camera_that_is_metres_off_the_vehicle_is_refused(write):
    """Centimetres were meant."""
    with pytest.raises(ConfigError, match=r"camera\.position_body_m\.0 = 10\.0.*less than or equal to 5"):
        read_config(write(RIG + "position_body_m = [10.0, 0.0, 5.0]"), RigConfig)


def test_paper_method_without_a_triangle_to_take_the_heading_from_is_refused(tmp_path):
    """It would search with the pad in sight, and never fix it."""
    (tmp_path / "pad.toml").write_text(PAD, encoding="utf-8")
    (tmp_path / "lens.toml").write_text(LENS, encoding="utf-8")
    rig = RIG.replace("pads/paper-38cm.toml", "pad.toml").replace("cameras/pi-fisheye-640.toml", "lens.toml")
    path = tmp_path / "rig.toml"
    path.write_text(rig + '[vision]\nmethod = "paper"\n', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"pad mine has none.*pnp"):
        load_rig(path)
    path.write_text(rig, encoding="utf-8")
    assert load_rig(path).landmark.name == "mine"


def test_resolve_takes_a_relative_path_from_the_file_that_names_it(tmp_path):
    assert resolve(tmp_path / "rig.toml", "pads/x.toml") == tmp_path / "pads" / "x.toml"
    assert resolve(tmp_path / "rig.toml", "/else/x.toml") == Path("/else/x.toml")
