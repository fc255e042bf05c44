import tomllib
from pathlib import Path

import numpy as np
import pytest

from app.errors import ConfigError
from app.estimation.height_table import computed_height_table, outer_triangle, read_height_table
from app.landmark import ContourSpec, Shape, build_landmark, paper_landmark

SHIPPED = Path(__file__).parents[3] / "configs" / "height-tables" / "paper.toml"

GOOD = {
    "name": '"mine"',
    "heights_m": "[0.5, 1.0, 2.0]",
    "centred_px": "[80.0, 40.0, 20.0]",
    "offset_px": "[70.0, 36.0, 18.0]",
    "offset_distance_px": "120.0",
    "side_m": "0.2",
    "focal_px": "400.0",
}


def write(folder, **changes):
    path = folder / "table.toml"
    path.write_text("\n".join(f"{k} = {v}" for k, v in {**GOOD, **changes}.items() if v is not None))
    return path


def test_shipped_table_is_table_two_of_the_paper():
    table = read_height_table(SHIPPED)
    assert table.heights_m.tolist() == [0.30, 0.79, 1.20, 1.63, 1.99, 2.43, 2.78]
    assert table.centred_px.tolist() == [167.59, 63.95, 40.82, 30.02, 24.19, 19.20, 16.55]
    assert table.offset_px.tolist() == [159.22, 56.44, 40.31, 27.78, 21.95, 17.80, 15.65]


def test_shipped_table_belongs_to_the_papers_triangle():
    # sqrt(1/8 * 4 / sqrt(3)) of 0.38 m
    side_m = tomllib.loads(SHIPPED.read_text())["side_m"]
    assert side_m == pytest.approx(0.204168, abs=1e-6)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"centred_px": "[80.0, 40.0]"}, "centred_px has 2 values, heights_m has 3"),
        ({"offset_px": "[70.0, 36.0, 18.0, 9.0]"}, "offset_px has 4 values"),
        ({"heights_m": "[0.5, 2.0, 1.0]"}, "heights_m must be positive and rise"),
        ({"heights_m": "[0.0, 1.0, 2.0]"}, "heights_m must be positive and rise"),
        ({"centred_px": "[80.0, 90.0, 20.0]"}, "centred_px must be positive and fall"),
        ({"centred_px": "[80.0, 40.0, -1.0]"}, "centred_px must be positive and fall"),
        ({"offset_distance_px": "0.0"}, "offset_distance_px"),
        ({"focal_px": None}, "key focal_px is missing"),
        ({"height_m": "3.0"}, "unknown key height_m"),
        ({"heights_m": "[1.0]", "centred_px": "[1.0]", "offset_px": "[1.0]"}, "heights_m"),
    ],
)
def test_wrong_table_is_an_error_that_names_file_and_key(tmp_path, changes, told):
    path = write(tmp_path, **changes)
    with pytest.raises(ConfigError) as caught:
        read_height_table(path)
    assert str(path) in str(caught.value)
    assert told in str(caught.value)


def test_missing_table_is_an_error_that_names_it(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.toml: no such file"):
        read_height_table(tmp_path / "nowhere.toml")


def test_good_table_is_read(tmp_path):
    table = read_height_table(write(tmp_path))
    assert (table.name, table.offset_distance_px, table.side_m, table.focal_px) == ("mine", 120.0, 0.2, 400.0)


def test_computed_table_is_that_of_a_perfect_camera():
    table = computed_height_table(paper_landmark(), 215.0)
    np.testing.assert_allclose(table.heights_m * table.centred_px, 215.0 * 0.204168, rtol=1e-5)
    np.testing.assert_array_equal(table.centred_px, table.offset_px)


def test_landmark_without_triangle_has_no_table():
    squares = build_landmark("squares", 0.4, (ContourSpec(Shape.SQUARE, 1.0), ContourSpec(Shape.SQUARE, 0.5)))
    assert computed_height_table(squares, 215.0) is None
    assert outer_triangle(squares) is None


def test_outer_triangle_of_the_paper_is_its_third_contour():
    index, contour = outer_triangle(paper_landmark())
    assert (index, contour.name) == (2, "T3")
