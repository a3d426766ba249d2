"""The value of white that is taken where a call does not name it."""

import numpy as np
import pytest
from skimage import data

import cvkern
from cvkern._whites import white_of
from cvkern.images import draw_points
from cvkern.scale.photographs import described, heap_of

PHOTO = data.camera()[100:260, 150:350]


@pytest.mark.parametrize(("image", "white"), [
    (PHOTO, 255),
    (PHOTO.astype(bool), 1),
    (np.array([[1, 2]], np.int8), 127),
    (PHOTO.astype(np.uint16), 255),
    (PHOTO.astype(np.int64), 255),
    (PHOTO.astype(np.uint16) * 4, 1023),
    (PHOTO.astype(np.uint16) * 16, 4095),
    (PHOTO.astype(np.int16) * 64, 16383),
    (PHOTO.astype(np.uint16) * 257, 65535),
    (np.array([[-5, 32767]], np.int16), 32767),
    (np.array([[0, 256]], np.uint16), 1023),
    (np.array([[0, 0]], np.uint16), 255),
    (PHOTO / 255, 1),
    (PHOTO / 200, 1),  # overshoot, or highlights
    (PHOTO.astype(np.float16), 255),
    (PHOTO * np.float32(1.02), 255),  # overshoot
    (PHOTO * 16.0, 4095),
    (np.array([[np.nan, 200.0]]), 1),
    (np.array([[np.inf, 200.0]]), 1),
    (np.array([[-np.inf, np.inf]]), 1),
    (np.array([[1e300, 1e300]]), 1),
    (np.array([[1e30, 1e30]]), 1),
])  # fmt: skip
def test_white_is_what_the_values_tell(image, white):
    assert white_of(image) == white
    assert white_of(image, 9) == 9


@pytest.mark.parametrize(("dtype", "factor", "white"), [
    (np.uint16, 16, 4095), (np.float32, 1, 255), (np.int32, 1, 255),
])  # fmt: skip
def test_every_function_takes_the_white_of_the_values(backend, dtype, factor, white):
    one = PHOTO.astype(dtype) * dtype(factor)
    two = np.roll(one, 7, axis=1)
    for function, images in (
        (cvkern.sift, (one,)),
        (cvkern.orb, (one,)),
        (cvkern.stereo_match, (two, one)),
    ):
        found, told = function(*images), function(*images, data_range=white)
        for a, b in zip(found, told, strict=True):
            np.testing.assert_array_equal(a, b)
        assert len(found[1])


def test_twelve_bits_are_drawn_as_eight():
    np.testing.assert_array_equal(
        draw_points(PHOTO.astype(np.uint16) * 257, [[5, 5]]), draw_points(PHOTO, [[5, 5]])
    )
    # 255 * 16 is 4080, 15 less than white: one grey level at most.
    drawn = draw_points(PHOTO.astype(np.uint16) * 16, [[5, 5]]).astype(int)
    assert abs(drawn - draw_points(PHOTO, [[5, 5]])).max() == 1


def test_photographs_of_a_heap_become_one_dtype_with_one_white(tmp_path):
    images = [PHOTO.astype(np.uint16) * 16, PHOTO.astype(np.uint16) * 15, PHOTO]
    files, notes = [], []
    for n, image in enumerate(images):
        files.append(tmp_path / f"{n}.png")
        notes.append(tmp_path / f"{n}.npz")
        cvkern.images.write_image(files[n], image)
        np.savez(notes[n], **described(image, None)._asdict())
    heap = heap_of(files, notes, 0)
    assert heap.whites == [4095, 4095, 4095]
    for image in (heap.images[2], heap.small[2]):
        assert image.dtype == np.uint16
        np.testing.assert_array_equal(image.read(), np.round(PHOTO * (4095 / 255)))
