"""Positions and directions as features: sines and cosines, spherical harmonics."""

from typing import Any

import numpy as np
import pytest
import scipy.special

from cvkern.radiance import positional_encoding, spherical_harmonics
from tests.radiance.fields import reference_perceptron as reference

F16, F32, I32 = np.float16, np.float32, np.int32

# With r = 2^k x less whole turns, exact in float32: pi r is rounded twice, to 2 x 2^-24 x pi at
# most, and the sine once more.
EXACT = 5e-7


def places(*shape, seed=0):
    """Return coordinates in [-1, 1], whole and half turns and the ends among them."""
    points = np.random.default_rng(seed).uniform(-1, 1, shape).astype(F32)
    points.flat[:9] = [0, 1, -1, 0.5, -0.5, 0.25, 2**-20, 1 - 2**-24, -0.75]
    return points


def units(*shape, seed=0):
    """Return unit vectors, those along the axes among them."""
    vectors = np.random.default_rng(seed).normal(size=shape)
    vectors.reshape(-1, 3)[:6] = np.vstack([np.eye(3), -np.eye(3)])
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(F32)


# ------------------------------------------------------------------------------------ primitives


@pytest.mark.parametrize("constant", [False, True])
@pytest.mark.parametrize("include_input", [False, True])
@pytest.mark.parametrize(("size", "frequencies", "width"), [(1, 1, 16), (3, 4, 32), (3, 10, 64)])
def test_positional(kernels, half, size, frequencies, width, include_input, constant):
    points, total, column = places(70, size), 61, 5
    features = kernels(
        "radiance.encodings.positional", points, np.array([total], I32), frequencies, include_input,
        constant, column, width, out=[((70, 80), half)],
    )  # fmt: skip
    want = reference.positional(points[:total], frequencies, include_input=include_input)
    if constant:
        want = np.hstack([want, np.ones((total, 1))])
    want = np.hstack([want, np.zeros((total, width - want.shape[1]))])
    atol = EXACT if half == F32 else EXACT + 2**-11  # numbers up to 1, rounded once
    np.testing.assert_allclose(features[:total, column : column + width], want, rtol=0, atol=atol)
    features[:total, column : column + width] = 77
    assert (features == 77).all()


def test_gather(kernels, half):
    rng = np.random.default_rng(0)
    table, rows = rng.normal(size=(9, 32)).astype(half), rng.integers(0, 9, 50).astype(I32)
    features = kernels("radiance.encodings.gather", table, rows, np.array([41], I32), 3,
                       out=[((50, 40), half)])  # fmt: skip
    np.testing.assert_array_equal(features[:41, 3:35], table[rows[:41]])
    features[:41, 3:35] = 77
    assert (features == 77).all()


@pytest.mark.parametrize("columns", [1, 4, 9, 16])
def test_first_harmonics(kernels, columns):
    directions = units(50, 3)
    values = kernels(
        "radiance.encodings.spherical_harmonics", directions, out=[((50, columns), F32)]
    )
    every = kernels("radiance.encodings.spherical_harmonics", directions, out=[((50, 16), F32)])
    np.testing.assert_array_equal(values, every[:, :columns])


# -------------------------------------------------------------------------------------------- API


@pytest.mark.parametrize("include_input", [False, True])
@pytest.mark.parametrize("frequencies", [1, 4, 10, 20])
def test_positional_encoding_is_equation_4(backend, frequencies, include_input):
    points = places(50, 4, 3)
    found = positional_encoding(points, frequencies, include_input=include_input)
    assert found.shape == (50, 4, 3 * (2 * frequencies + include_input))
    assert found.dtype == F32
    want = reference.positional(points.reshape(-1, 3), frequencies, include_input=include_input)
    np.testing.assert_allclose(found.reshape(want.shape), want, rtol=0, atol=EXACT)


def test_positional_encoding_far_from_the_origin(backend):
    """Whole turns are taken away exactly, however many they are."""
    points = np.array([[1e6 + 0.125], [-3e4 - 1 / 3], [2.0**40]], F32)
    np.testing.assert_allclose(
        positional_encoding(points, 12), reference.positional(points, 12), rtol=0, atol=EXACT
    )


def test_positional_encoding_has_the_period_that_it_says(backend):
    points = np.round(places(30, 2) * 2**16) / F32(2**16)  # so that 2 more are exact
    first, second = (positional_encoding(points + F32(n), include_input=False) for n in (0, 2))
    np.testing.assert_array_equal(first, second)


def test_what_is_not_finite_is_nan(backend):
    found = positional_encoding(np.array([[np.nan, 0.5, np.inf]], F32), 2, include_input=False)
    assert np.isnan(found).tolist() == [[True] * 4 + [False] * 4 + [True] * 4]


@pytest.mark.parametrize("degree", range(4))
def test_spherical_harmonics_are_those_of_scipy(backend, degree):
    if not hasattr(scipy.special, "sph_harm_y"):
        pytest.skip("needs scipy 1.15")
    directions = units(7, 30, 3)
    found = spherical_harmonics(directions, degree)
    assert found.shape == (7, 30, (degree + 1) ** 2)
    assert found.dtype == F32
    x, y, z = np.moveaxis(directions.astype(float), -1, 0)
    polar, azimuth = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
    for l in range(degree + 1):
        for m in range(-l, l + 1):
            value = scipy.special.sph_harm_y(l, abs(m), polar, azimuth)
            want = np.sqrt(2) * (value.imag if m < 0 else value.real) if m else value.real
            # Polynomials of degree 3 in numbers up to 1, with coefficients up to 5.
            np.testing.assert_allclose(found[..., l * (l + 1) + m], want, rtol=0, atol=2e-6)


def test_spherical_harmonics_are_orthonormal(backend):
    """By a product of Gauss-Legendre and trapezium rules, exact up to degree 6."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    turns = 2 * np.pi * np.arange(8) / 8
    z, azimuth = (a.ravel() for a in np.meshgrid(nodes, turns, indexing="ij"))
    root = np.sqrt(1 - z * z)
    values = spherical_harmonics(np.stack([root * np.cos(azimuth), root * np.sin(azimuth), z], 1))
    area = np.repeat(weights, 8) * 2 * np.pi / 8
    inner = np.einsum("n,ni,nj->ij", area, values.astype(float), values.astype(float))
    np.testing.assert_allclose(inner, np.eye(16), atol=2e-6)  # sums of 4 pi in all, as above


CALLS: dict[str, Any] = {
    "positional_encoding": lambda x: positional_encoding(x, 3),
    "spherical_harmonics": lambda x: spherical_harmonics(x, 2),
}


@pytest.mark.parametrize("name", CALLS)
def test_any_dtype_layout_and_rank(backend, name):
    call, points = CALLS[name], units(4, 5, 3)
    want = call(points)
    np.testing.assert_array_equal(call(points.astype(float)), want)
    np.testing.assert_array_equal(call(points.tolist()), want)
    np.testing.assert_array_equal(call(np.asfortranarray(points)), want)
    np.testing.assert_array_equal(call(np.repeat(points, 2, 1)[:, ::2]), want)
    np.testing.assert_array_equal(call(points[2, 3]), want[2, 3])
    np.testing.assert_array_equal(call(np.eye(3, dtype=np.uint8)), call(np.eye(3)))
    frozen = points.copy()
    frozen.flags.writeable = False
    np.testing.assert_array_equal(call(frozen), want)


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("library", ["torch", "jax"])
def test_the_callers_library(backend, name, library):
    module, points = pytest.importorskip(library), units(4, 5, 3)
    if library == "torch":
        given = module.from_numpy(points)
    else:
        given = module.device_put(points, module.devices("cpu")[0])
    found = CALLS[name](given)
    assert type(found) is type(given)
    np.testing.assert_array_equal(np.asarray(found), CALLS[name](points))


NO_NUMBER: Any = "2"


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: positional_encoding(0.5), ValueError, "points must be 1-D or .*, got shape"),
        (lambda: positional_encoding(np.ones((2,) * 5)), ValueError, "points must be 1-D or"),
        (lambda: positional_encoding(np.ones((0, 3))), ValueError, "points must not be empty"),
        (lambda: positional_encoding(["a"]), TypeError, "points must hold real numbers"),
        (lambda: positional_encoding([1.0], 0), ValueError, r"frequencies must be in \[1, 32\]"),
        (lambda: positional_encoding([1.0], 33), ValueError, r"frequencies must be in \[1, 32\]"),
        (
            lambda: positional_encoding([1.0], NO_NUMBER),
            TypeError,
            "frequencies must be an integer",
        ),
        (
            lambda: positional_encoding(np.broadcast_to(F32(0), (2**24, 1)), 32),
            ValueError,
            "encoding must have at most 536870912 elements, got 1090519040",
        ),
        (lambda: spherical_harmonics(1.0), ValueError, "directions must be 1-D or"),
        (lambda: spherical_harmonics([[1.0, 0.0]]), ValueError, "directions must have 3 columns"),
        (lambda: spherical_harmonics(np.ones((0, 3))), ValueError, "directions must not be empty"),
        (lambda: spherical_harmonics(["a"]), TypeError, "directions must hold real numbers"),
        (lambda: spherical_harmonics([1.0, 0, 0], 4), ValueError, r"degree must be in \[0, 3\]"),
        (lambda: spherical_harmonics([1.0, 0, 0], -1), ValueError, r"degree must be in \[0, 3\]"),
        (
            lambda: spherical_harmonics([1.0, 0, 0], NO_NUMBER),
            TypeError,
            "degree must be an integer",
        ),
        (
            lambda: spherical_harmonics(np.broadcast_to(F32(0), (2**26, 3))),
            ValueError,
            "harmonics must have at most 536870912 elements, got 1073741824",
        ),
    ],
)
def test_errors(call, error, message):
    with pytest.raises(error, match=message):
        call()
