"""Native code in its own files: results and refusals."""

# The kernel is in Warp's language, which no Python type checker reads.
# pyright: reportIndexIssue=false

import numpy as np
import pytest
import scipy.ndimage
import warp as wp

from cvkern.kernels.warp import _native

FILE = "native_example.h"
OPTIONS = {"enable_backward": False}


def blur(radius):
    @_native.kernel(FILE, OPTIONS, RADIUS=radius)
    def blur_row(row: int, image: wp.array2d[float], out: wp.array2d[float]): ...

    return blur_row


@pytest.mark.parametrize("radius", [1, 3])
def test_a_kernel_of_native_code(radius):
    image = np.random.default_rng(0).random((2, 40), np.float32)
    out = wp.zeros(image.shape, dtype=float, device="cpu")
    for row in range(2):
        inputs = [row, wp.array(image, dtype=float, device="cpu"), out]
        wp.launch(blur(radius), dim=1, inputs=inputs, device="cpu")
    expected = scipy.ndimage.uniform_filter1d(image, 2 * radius + 1, axis=1, mode="nearest")
    # Sums of at most 7 numbers below 1: 7 roundings of 2^-24 each.
    np.testing.assert_allclose(out.numpy(), expected, rtol=0, atol=7 * 2**-24)


@_native.kernel(FILE)
def add_one(out: wp.array[int]): ...


def test_without_options_a_kernel_belongs_to_the_module_of_the_file():
    assert add_one.module is wp.get_module(__name__)
    assert blur(1).module is not add_one.module
    out = wp.zeros(1, dtype=int, device="cpu")
    wp.launch(add_one, dim=3, outputs=[out], device="cpu")
    assert out.numpy()[0] == 3


@_native.func_native(FILE)
def plus_one(number: int) -> int: ...


@wp.kernel
def count(out: wp.array[int]):
    out[0] = plus_one(41)


def test_a_function_of_native_code():
    out = wp.zeros(1, dtype=int, device="cpu")
    wp.launch(count, dim=1, outputs=[out], device="cpu")
    assert out.numpy()[0] == 42


@_native.each(FILE, RADIUS=1)
def blur_row(row: int, image: wp.array2d[float], out: wp.array2d[float]): ...


def test_a_kernel_over_slabs_calls_its_function_for_each_row():
    image = np.arange(12, dtype=np.float32).reshape(4, 3)
    out = wp.full(image.shape, -1.0, dtype=float, device="cpu")
    inputs = [7, 1, 3, wp.array(image, dtype=float, device="cpu"), out]
    wp.launch(blur_row, dim=1, inputs=inputs, device="cpu")
    expected = np.full(image.shape, -1, np.float32)
    expected[1:3] = scipy.ndimage.uniform_filter1d(image[1:3], 3, axis=1, mode="nearest")
    np.testing.assert_allclose(out.numpy(), expected, rtol=0, atol=1e-5)


def refused(message, stub, file=FILE, **constants):
    with pytest.raises(ImportError) as info:
        _native.func_native(file, **constants)(stub)
    assert str(info.value) == message


def test_constants_are_those_that_it_needs():
    def blur_row(row, image, out): ...

    refused(f"{FILE}: blur_row needs ['RADIUS'], got []", blur_row)
    got = ["RADIUS", "WIDTH"]
    refused(f"{FILE}: blur_row needs ['RADIUS'], got {got}", blur_row, RADIUS=1, WIDTH=2)


def test_parameters_are_those_that_it_takes():
    def blur_row(row: int, out: wp.array2d[float], image: wp.array2d[float]): ...

    message = f"{FILE}: blur_row takes ['row', 'image', 'out'], got ['row', 'out', 'image']"
    refused(message, blur_row, RADIUS=1)


def test_a_function_that_is_not_there():
    def nothing(row: int): ...

    refused(f"{FILE} must have a function nothing", nothing)


def test_a_function_without_an_end():
    def without_an_end(number: int): ...

    refused(f"{FILE}: without_an_end must end with a brace", without_an_end)
