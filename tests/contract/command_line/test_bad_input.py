"""Every command's bad input: one line that names what, where and what to do; exit code 2; no traceback."""

import socket
import subprocess
import sys

import pytest

from app.wiring import CONFIGS

LENS = CONFIGS / "cameras" / "pi-camera3-640.toml"
CROSSING = 'name = "bad"\nsize_cm = 38.0\nquiet_zone_cm = 46.0\n' + "".join(
    f'[[contour]]\nshape = "square"\narea_ratio = {ratio}\n' for ratio in (1.0, 0.5, 0.6)
)
"""The third is larger than the second: sides of 26.87 and 29.43 cm, so it sticks out by 1.28 cm."""


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["fly"], "no such command 'fly'"),
        (["demo", "--spead", "3"], "no such option: --spead"),
        (["demo", "--experiment", "boat"], "'boat' is not one of 'static', 'car'"),
        (["demo", "--seed", "-1"], "invalid value for '--seed'"),
        (["demo", "--seed", "one"], "invalid value for '--seed'"),
        (["run"], "missing option '--config'"),
        (["run", "--config", "a.toml", "--seed", "3"], "option '--seed' wants '--scenario'"),
        (["run", "--config", "a.toml", "--scenario", "static", "--seed", "-3"], "invalid value for '--seed'"),
        (["check"], "missing option '--config'"),
        (["phone"], "missing argument 'action'"),
        (["phone", "dance"], "'dance' is not one of"),
        (["phone", "land", "--height", "0.1"], "invalid value for '--height'"),
        (["phone", "land", "--pad-speed", "13.5"], "options '--pad-speed' and '--pad-heading' want each other"),
        (["phone", "land", "--pad-speed", "0", "--pad-heading", "9"], "invalid value for '--pad-speed'"),
        (["landmark"], "missing option '--out'"),
        (["landmark", "--out", "a.pdf", "--tile", "a5"], "'a5' is not one of"),
        (["landmark", "--out", "a.pdf", "--size-cm", "0"], "invalid value for '--size-cm'"),
        (["detect", "a.png"], "missing option '--camera'"),
        (["detect", "--camera", LENS], "missing argument 'paths'"),
        (["detect", "--camera", LENS, "--method", "guess", "a.png"], "'guess' is not one of 'pnp', 'paper'"),
    ],
)
def test_command_line_that_is_not_understood_names_the_option_and_the_help(alight, arguments, says):
    error = alight(*arguments).error
    assert says in error
    command = arguments[0] if arguments[0] != "fly" else ""
    assert error.endswith(f"see alight {command} --help".replace("  ", " "))


@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize(
    ("section", "lines", "says"),
    [
        ("guidance", "speeed_max_m_s = 5.0", "unknown key guidance.speeed_max_m_s = 5.0; did you mean speed_max_m_s?"),
        ("guidance", "speed_max_km_h = 20.0", "did you mean speed_max_m_s (units are part of the name)?"),
        ("guidance", "speed_max_m_s = 2000.0", "guidance.speed_max_m_s = 2000.0"),
        ("guidance", 'speed_max_m_s = "fast"', "guidance.speed_max_m_s = 'fast'"),
        ("vision", 'method = "paper"\nheight_table = "no.toml"', "vision.height_table = 'no.toml': no such file"),
        ("radar", "range_m = 3", "unknown key radar"),
    ],
)
def test_rig_with_a_wrong_key_unit_or_value_names_file_key_and_limit(alight, rig, command, section, lines, says):
    path = rig(**{section: lines})
    error = alight(command, "--config", path).error
    assert str(path) in error
    assert says in error


@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize(
    ("head", "says"),
    [
        ("pad = ", "not valid TOML"),
        ('pad = "nowhere.toml"', "pad = 'nowhere.toml': no such file"),
        ("[pad]", "pad = "),
        ("# no pad", "key pad is missing"),
    ],
)
def test_rig_with_a_wrong_pad_names_the_file_and_the_key(alight, rig, command, head, says):
    path = rig(head)
    error = alight(command, "--config", path).error
    assert str(path) in error
    assert says in error


@pytest.mark.parametrize("command", ["run", "check"])
def test_rig_file_that_is_missing_is_named_with_the_nearest(alight, rig, command):
    path = rig()
    assert alight(command, "--config", path.with_name("rigg.toml")).error.endswith(f"did you mean {path}?")


@pytest.mark.parametrize("command", ["run", "check"])
def test_rig_whose_pad_cannot_be_drawn_names_the_contours(alight, rig, tmp_path, command):
    pad = tmp_path / "pad.toml"
    pad.write_text(CROSSING, encoding="utf-8")
    assert "S3 crosses S2: it sticks out by 12.8" in alight(command, "--config", rig('pad = "pad.toml"')).error


def test_landmark_that_cannot_be_drawn_names_contours_and_limit_and_writes_nothing(alight, tmp_path):
    pad, out = tmp_path / "pad.toml", tmp_path / "pad.pdf"
    pad.write_text(CROSSING, encoding="utf-8")
    error = alight("landmark", "--config", pad, "--out", out).error
    assert "S3 crosses S2: it sticks out by 12.8" in error
    assert "2.69 mm" in error
    assert not out.exists()


@pytest.mark.parametrize("name", ["pad.gif", "pad", "none/pad.pdf"])
def test_landmark_file_that_cannot_be_written_is_named(alight, tmp_path, name):
    assert str(tmp_path / name) in alight("landmark", "--out", tmp_path / name).error


def test_camera_that_does_not_open_is_told_before_the_autopilot_is_looked_for(alight, rig, tmp_path):
    camera = f'driver = "opencv"\nsource = "/dev/video97"\nlens = "{LENS}"'
    path = rig(camera=camera, autopilot='address = "udpin://127.0.0.1:24711"\nconnect_timeout_s = 500.0')
    error = alight("run", "--config", path).error
    assert "/dev/video97: the camera does not open; plug it in" in error
    assert list((tmp_path / "flights").iterdir()) == []


def test_camera_of_a_file_that_is_missing_is_named(alight, rig):
    camera = f'driver = "opencv"\nsource = "gone.mp4"\nlens = "{LENS}"'
    assert "gone.mp4: no such file" in alight("run", "--config", rig(camera=camera)).error


def test_address_without_an_autopilot_is_named_with_the_time_waited(alight, rig, tmp_path):
    done = alight("run", "--config", rig())
    assert done.code == 2
    *log, error = done.err.splitlines()
    assert log == []
    assert error.startswith("alight: error: udpin://127.0.0.1:24711: no autopilot's heartbeat within 0.5 s; start PX4")
    assert list((tmp_path / "flights").iterdir()) == []


def test_address_that_another_program_holds_is_named(alight, rig):
    with socket.socket(type=socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 24711))
        assert "another program holds port 24711" in alight("run", "--config", rig()).error


SYNTHETIC = f'driver = "synthetic"\nlens = "{LENS}"'


def test_scenario_that_nobody_knows_is_refused_with_those_that_ship(alight, rig):
    error = alight("run", "--config", rig(), "--scenario", "car-9").error
    assert "no scenario is called 'car-9'" in error
    assert all(path.stem in error for path in (CONFIGS / "scenarios").glob("*.toml"))


@pytest.mark.parametrize("world", ["", 'vehicle = "built-in"'], ids=["default", "built-in"])
def test_scenario_on_a_rig_that_is_no_px4_sitl_says_what_can_fly_it(alight, rig, world):
    path = rig(camera=SYNTHETIC, simulator=world)
    error = alight("run", "--config", path, "--scenario", "static").error
    assert f'{path}: a scenario wants camera.driver = "synthetic" and simulator.vehicle = "px4"' in error
    assert "give configs/sitl.toml" in error
    assert "alight campaign --scenario static" in error


def test_scenario_that_px4_cannot_fly_is_refused_before_anything_starts(alight, rig, tmp_path):
    path = rig(camera=SYNTHETIC, simulator='vehicle = "px4"')
    assert "the deck rides on waves" in alight("run", "--config", path, "--scenario", "boat").error
    assert not (tmp_path / "flights").exists()


def test_scenario_without_a_px4_says_where_it_was_looked_for_and_what_to_start(alight, rig, tmp_path):
    path = rig(camera=SYNTHETIC, simulator='vehicle = "px4"\npx4_truth_address = "udpin:127.0.0.1:24714"')
    done = alight("run", "--config", path, "--scenario", "static", "--out", tmp_path / "out")
    assert done.code == 2
    assert "udpin://127.0.0.1:24711: no autopilot's heartbeat within 0.5 s; start PX4" in done.err.splitlines()[-1]


@pytest.mark.parametrize("address", ["udp:14540", "udpin://127.0.0.1", "serial:///dev/ttyNONE:57600"])
def test_address_that_cannot_work_is_named(alight, rig, address):
    assert address in alight("run", "--config", rig(autopilot=f'address = "{address}"')).error


def test_camera_driver_synthetic_without_a_simulator_says_what_to_add(alight, rig):
    camera = f'driver = "synthetic"\nlens = "{LENS}"'
    assert "no [simulator]; add that table" in alight("run", "--config", rig(camera=camera)).error


@pytest.mark.parametrize("command", ["demo", "run"])
def test_out_folder_that_cannot_be_made_is_named(alight, rig, tmp_path, command):
    (tmp_path / "file").write_text("in the way")
    arguments = ["--config", rig()] if command == "run" else []
    error = alight(command, *arguments, "--out", tmp_path / "file" / "out").error
    assert error == (
        f"alight: error: {tmp_path}/file/out: can't be made (Not a directory); give another folder with --out"
    )


def test_phone_with_nobody_there_is_told_what_to_start(alight):
    error = alight("phone", "land", "--address", "udpin://127.0.0.1:24713", "--silence", "0.5").error
    assert error.startswith("alight: error: udpin://127.0.0.1:24713: nobody answers within 0.5 s; start alight run")


def test_phone_with_an_address_that_is_none_is_told_how_to_write_it(alight):
    assert "14590: not a UDP address; write" in alight("phone", "land", "--address", "14590").error


def test_check_tells_all_faults_at_once(alight, rig, tmp_path):
    (tmp_path / "file").write_text("in the way")
    camera = f'driver = "opencv"\nsource = "/dev/video97"\nlens = "{LENS}"'
    with socket.socket(type=socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 24712))
        path = rig(camera=camera, recorder=f'directory = "{tmp_path}/file"')
        done = alight("check", "--config", path, "--seconds", "0.5")
    assert done.error == f"alight: error: {path}: 4 fault(s); mend what is marked FAULT above"
    lines = {line.split()[1].rstrip(":"): line for line in done.out.splitlines()}
    assert lines["files"].startswith("ok")
    assert "/dev/video97: the camera does not open" in lines["camera"]
    assert "no autopilot's heartbeat" in lines["autopilot"]
    assert "another program holds port 24712" in lines["phone"]
    assert f"{tmp_path}/file: can't be" in lines["record"]
    assert all(lines[part].startswith("FAULT") for part in ("camera", "autopilot", "phone", "record"))


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("text.png", b"no image", "text.png: not an image"),
        ("empty.jpg", b"", "empty.jpg: not an image"),
        ("small.pgm", b"P5 4 3 255\n" + bytes(12), "small.pgm: 4x3 pixels, the camera file says 640x480"),
    ],
)
def test_image_that_is_none_is_named(alight, tmp_path, name, content, says):
    path = tmp_path / name
    path.write_bytes(content)
    assert says in alight("detect", "--json", "--camera", LENS, path).error


@pytest.mark.parametrize("command", ["detect", "run"])
def test_video_that_is_none_is_named_and_its_decoder_says_nothing(rig, tmp_path, command):
    path = tmp_path / "text.mp4"
    path.write_text("no video")
    camera = f'driver = "opencv"\nsource = "{path}"\nlens = "{LENS}"'
    arguments = ["--camera", LENS, path] if command == "detect" else ["--config", rig(camera=camera)]
    # A process of its own: what a decoder prints is settled once, when it is first used.
    done = subprocess.run(
        [sys.executable, "-m", "app", command, *arguments], capture_output=True, text=True, timeout=60, check=False
    )
    (error,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (2, "")
    assert error.startswith(f"alight: error: {path}: ")


def test_images_that_are_not_there_are_named(alight, tmp_path):
    (tmp_path / "empty").mkdir()
    assert "none.png: no such file or folder" in alight("detect", "--camera", LENS, tmp_path / "none.png").error
    assert "empty: no image or video" in alight("detect", "--camera", LENS, tmp_path / "empty").error


@pytest.mark.parametrize("option", ["--camera", "--pad"])
def test_camera_or_pad_file_that_is_missing_is_named(alight, pad_image, option):
    files = {"--camera": LENS, option: "nowhere.toml"}
    error = alight("detect", *(x for item in files.items() for x in item), pad_image).error
    assert "nowhere.toml: no such file" in error


def test_folder_for_drawings_that_cannot_be_made_is_named(alight, pad_image, tmp_path):
    (tmp_path / "file").write_text("in the way")
    error = alight("detect", "--camera", LENS, "--draw", tmp_path / "file" / "out", pad_image).error
    assert f"{tmp_path}/file/out/pad.png: can't be written" in error
