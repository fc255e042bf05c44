import numpy as np
import pytest

from app.vision.preprocess import binarise, global_otsu, grow, otsu, prepare, to_grey, whole


@pytest.fixture
def two_levels():
    image = np.full((120, 160), 200, dtype=np.uint8)
    image[30:90, 40:100] = 40
    return image


def test_otsu_of_two_levels_lies_between_them(two_levels):
    assert 40 <= otsu(two_levels) < 200
    assert 40 <= global_otsu(two_levels) < 200


def test_binarise_marks_black(two_levels):
    binary = binarise(two_levels, 100)
    assert binary[60, 60] == 255
    assert binary[0, 0] == 0


def test_region_of_a_colour_image_is_grey_by_luma():
    image = np.zeros((10, 12, 3), dtype=np.uint8)
    image[..., 1] = 100
    grey = to_grey(image, (2, 3, 7, 9))
    assert grey.shape == (6, 5)
    assert set(np.unique(grey)) == {59}  # 0.587 of 100, BT.601


def test_reduction_averages_and_maps_pixels_back(two_levels):
    prepared = prepare(two_levels, (20, 10, 120, 110), reduction=2)
    assert prepared.smooth.shape == (50, 50)
    # The middle of the first reduced pixel lies between the first two pixels of the region.
    np.testing.assert_allclose(prepared.to_frame(np.array([[0.0, 0.0], [10.0, 5.0]])), [[20.5, 10.5], [40.5, 20.5]])


def test_blur_keeps_the_mean(two_levels):
    prepared = prepare(two_levels, whole(two_levels), sigma_px=1.0)
    assert float(prepared.smooth.mean()) == pytest.approx(float(two_levels.mean()), abs=0.5)


def test_no_blur_leaves_the_image_alone(two_levels):
    np.testing.assert_array_equal(prepare(two_levels, whole(two_levels), sigma_px=0.0).smooth, two_levels)


def test_grown_region_stays_inside_the_image():
    assert grow((5, 50, 150, 110), 20, (160, 120)) == (0, 30, 160, 120)
