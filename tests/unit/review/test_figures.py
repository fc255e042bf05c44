"""The paper's figures: what their curves hold, and that every flight, however short, has them."""

import cv2
import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from app.errors import RecorderError
from app.review.figures import draw_binary, draw_figures
from app.review.flight import Flight


@pytest.fixture(scope="module")
def flight():
    """Take-off at 100 s; at 103 s 3 m up and sinking at 0.5 m/s, the pad 2.8 m below and 5 m away; landed at 115 s."""
    phases = [
        (98.0, "idle"),
        (100.0, "takeoff"),
        (104.0, "search"),
        (107.0, "track"),
        (111.0, "land"),
        (115.0, "landed"),
    ]
    return Flight(
        vehicle_t_s=np.array([98.0, 103.0, 117.0]),
        vehicle_pos_ned_m=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -3.0], [0.0, 0.0, 0.0]]),
        vehicle_vel_ned_m_s=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]]),
        fix_t_s=np.array([103.0]),
        fix_height_m=np.array([2.8]),
        fix_horizontal_m=np.array([5.0]),
        phases=[(t, phase, "") for t, phase in phases],
    )


@pytest.fixture(scope="module")
def drawn(flight, tmp_path_factory):
    """By title: curves (label: (times, values)), shades (label: (begin, width)) and limits of the time axis."""
    found = {}
    save = Figure.savefig

    def look(figure, path, **options):
        (axes,) = figure.axes
        curves = {line.get_label(): line.get_xydata().T for line in axes.get_lines()}
        shades = {patch.get_label(): (patch.get_x(), patch.get_width()) for patch in axes.patches}
        found[axes.get_title()] = (curves, shades, axes.get_xlim())
        save(figure, path, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", look)
        found["paths"] = draw_figures(flight, "car", tmp_path_factory.mktemp("figures"))
    return found


def test_figures_show_time_since_the_mission_began(drawn):
    curves, _, limits = drawn["car: vertical velocity"]
    np.testing.assert_allclose(curves["down"], [[-2.0, 3.0, 17.0], [0.0, 0.5, 0.0]])
    assert limits == (0.0, 17.0)  # 15 s of mission and 2 s of rest


def test_figures_show_height_by_vision_beside_the_barometers(drawn):
    curves, _, _ = drawn["car: height"]
    np.testing.assert_allclose(curves["vision (above the pad)"], [[3.0], [2.8]])
    np.testing.assert_allclose(curves["barometer (PX4, above home)"], [[-2.0, 3.0, 17.0], [0.0, 3.0, 0.0]])


def test_figures_show_the_distance_over_ground(drawn):
    np.testing.assert_allclose(drawn["car: horizontal distance to the pad"][0]["vision"], [[3.0], [5.0]])


def test_figures_shade_each_phase_for_its_time(drawn):
    shades = drawn["car: vertical velocity"][1]
    assert shades == {
        "takeoff": pytest.approx((0.0, 4.0)),
        "search": pytest.approx((4.0, 3.0)),
        "track": pytest.approx((7.0, 4.0)),
        "land": pytest.approx((11.0, 4.0)),
        "landed": pytest.approx((15.0, 2.0)),
    }


def test_figures_are_written_as_images_and_closed(drawn):
    paths = drawn["paths"]
    assert [p.name for p in paths] == ["car-vertical-velocity.png", "car-height.png", "car-distance.png"]
    assert all(cv2.imread(str(path)).std() > 5 for path in paths)
    assert plt.get_fignums() == []


@pytest.mark.parametrize("phases", [[], [(5.0, "takeoff", "takeoff: commanded")]])
def test_figures_of_an_almost_empty_record_are_empty_and_no_error(tmp_path, phases):
    assert all(path.exists() for path in draw_figures(Flight(phases=phases), "static", tmp_path))


def test_figure_that_cannot_be_written_is_an_error_that_names_it(flight, tmp_path):
    (tmp_path / "car-vertical-velocity.png").mkdir()
    with pytest.raises(RecorderError, match=r"car-vertical-velocity\.png: can't be written"):
        draw_figures(flight, "car", tmp_path)
    assert plt.get_fignums() == []


def test_binary_image_stands_beside_the_original(tmp_path):
    original = np.full((48, 64), 120, np.uint8)
    binary = np.zeros((48, 64), np.uint8)
    path = draw_binary(original, binary, "car", tmp_path)
    assert path.name == "car-original-and-binary.png"
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    rows, columns = picture.shape
    assert picture[rows // 2, columns // 4] == 120
    assert picture[rows // 2, 3 * columns // 4] == 0
