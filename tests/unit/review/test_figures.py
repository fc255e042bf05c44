"""The paper's figures: what their curves hold, and that every flight, however short, has them."""

import cv2
import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from app.errors import RecorderError
from app.messages import Phase
from app.review.figures import draw_binary, draw_figures
from app.review.flight import Flight, collect_flight


@pytest.fixture
def drawn(monkeypatch):
    """Titles and curves (label: (times, values)) of the figures that are written."""
    found = {}
    save = Figure.savefig

    def look(figure, path, **options):
        (axes,) = figure.axes
        curves = {line.get_label(): line.get_xydata().T for line in axes.get_lines()}
        shades = {
            patch.get_label(): (patch.get_x(), patch.get_width())
            for patch in axes.patches
            if not patch.get_label().startswith("_")
        }
        found[axes.get_title()] = (curves, shades, axes.get_xlim())
        save(figure, path, **options)

    monkeypatch.setattr(Figure, "savefig", look)
    return found


@pytest.fixture
def flight(items, recorded):
    """Take-off at 100 s; at 103 s 3 m up and sinking at 0.5 m/s, the pad 2.8 m below and 5 m away; landed at 115 s."""
    seen = [items.vehicle(103.0, 3.0, 0.5), items.fix(103.0, 3.0, 4.0, 2.8)]
    return collect_flight(recorded([*seen, *items.landing()[:-2], items.vehicle(117.0)]))


def test_figures_show_time_since_the_mission_began(flight, drawn, tmp_path):
    draw_figures(flight, "car", tmp_path)
    curves, _, limits = drawn["car: vertical velocity"]
    t, down = curves["down"]
    assert down[np.argmin(np.abs(t - 3.0))] == 0.5
    assert limits == (0.0, 17.0)  # 15 s of mission and 2 s of rest


def test_figures_show_height_by_vision_beside_the_barometers(flight, drawn, tmp_path):
    draw_figures(flight, "car", tmp_path)
    curves, _, _ = drawn["car: height"]
    np.testing.assert_allclose(curves["vision (above the pad)"], [[3.0], [2.8]])
    t, height = curves["barometer (PX4, above home)"]
    assert height[np.argmin(np.abs(t - 3.0))] == 3.0


def test_figures_show_the_distance_over_ground(flight, drawn, tmp_path):
    draw_figures(flight, "car", tmp_path)
    np.testing.assert_allclose(drawn["car: horizontal distance to the pad"][0]["vision"], [[3.0], [5.0]])


def test_figures_shade_each_phase_for_its_time(flight, drawn, tmp_path):
    draw_figures(flight, "car", tmp_path)
    shades = drawn["car: vertical velocity"][1]
    assert shades["takeoff"] == pytest.approx((0.0, 4.0))
    assert shades["track"] == pytest.approx((7.0, 4.0))
    assert shades["landed"] == pytest.approx((15.0, 2.0))


def test_figures_are_written_as_images_and_closed(flight, tmp_path):
    paths = draw_figures(flight, "car", tmp_path)
    assert [p.name for p in paths] == ["car-vertical-velocity.png", "car-height.png", "car-distance.png"]
    assert all(cv2.imread(str(path)).std() > 5 for path in paths)
    assert plt.get_fignums() == []


def test_figures_of_an_empty_record_are_empty_and_no_error(tmp_path):
    assert all(path.exists() for path in draw_figures(Flight(), "static", tmp_path))


def test_figures_of_a_flight_that_ended_as_it_began_are_no_error(items, recorded, tmp_path):
    flight = collect_flight(recorded([items.report(5.0, Phase.TAKEOFF, "takeoff: commanded")]))
    assert len(draw_figures(flight, "static", tmp_path)) == 3


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
