"""Errors of compositing."""

from typing import Any

import numpy as np
import pytest

import cvkern
from cvkern.radiance import Composite, composite_rays, composite_rays_backward
from tests.refusals import refused

pytestmark = pytest.mark.usefixtures("no_kernel_runs")

GOOD: Any = {
    "density": np.ones(5),
    "color": np.ones((5, 3)),
    "distances": np.ones((5, 2)),
    "spans": np.array([[0, 2], [9, 0], [2, 3]]),
}
SEEN = Composite(np.ones((3, 3)), np.ones(3), None, np.ones(3))


def either_refuses(error, message, **changes):
    """Both passes refuse what differs from GOOD."""
    for function in (composite_rays, lambda **given: composite_rays_backward(SEEN, **given)):
        refused(error, message, function, **(GOOD | changes))


def test_good_samples_are_not_refused():
    for call in (lambda: composite_rays(**GOOD), lambda: composite_rays_backward(SEEN, **GOOD)):
        with pytest.raises(AssertionError, match="a kernel was launched"):
            call()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("density", 5, "density must be 1-D, got shape ()"),
        ("density", np.ones((5, 1)), "density must be 1-D, got shape (5, 1)"),
        ("color", np.ones(5), "color must have shape (5, 3), got (5,)"),
        ("color", np.ones((5, 4)), "color must have shape (5, 3), got (5, 4)"),
        ("distances", np.ones(5), "distances must have shape (5, 2), got (5,)"),
        ("distances", np.ones((4, 2)), "distances must have shape (5, 2), got (4, 2)"),
        ("spans", [0, 5], "spans must have shape (R, 2), got (2,)"),
        ("spans", np.zeros((2, 3), int), "spans must have shape (R, 2), got (2, 3)"),
        (
            "spans",
            np.broadcast_to(np.int32(0), (2**26, 2)),
            "spans must have at most 67108863 rows, got 67108864",
        ),
        ("stop", -1, "stop must be >= 0 and finite, got -1"),
        ("stop", np.nan, "stop must be >= 0 and finite, got nan"),
    ],
)
def test_shapes_and_numbers(name, value, message):
    either_refuses(ValueError, message, **{name: value})


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("density", np.ones(5, complex), "density must hold real numbers, got dtype complex128"),
        ("color", np.full((5, 3), "a"), "color must hold real numbers, got dtype <U1"),
        ("distances", np.full((5, 2), None), "distances must hold real numbers, got dtype object"),
        ("spans", np.zeros((3, 2)), "spans must hold integers, got dtype float64"),
        ("stop", "a", "stop must be a number, got 'a'"),
    ],
)
def test_types(name, value, message):
    either_refuses(TypeError, message, **{name: value})


@pytest.mark.parametrize(
    ("span", "said"),
    [
        ((0, 6), "6 from 0"),
        ((5, 1), "1 from 5"),
        ((-1, 2), "2 from -1"),
        ((2, -1), "-1 from 2"),
        ((2**32, 1), "1 from 4294967296"),
    ],
)
def test_rows_of_no_sample(span, said):
    message = f"spans must be rows of the 5 samples, got {said} on for ray 1"
    either_refuses(ValueError, message, spans=np.array([[0, 0], span, [0, 0]]))


def test_rows_of_two_rays():
    """Each pass may look at a sample twice, but its gradient has one place."""
    spans = np.array([[3, 2], [9, 0], [0, 4]])
    message = "spans must not overlap, got row 3 for rays 2 and 0"
    refused(ValueError, message, composite_rays_backward, SEEN, **(GOOD | {"spans": spans}))
    with pytest.raises(AssertionError, match="a kernel was launched"):
        composite_rays(**(GOOD | {"spans": spans}))


def test_gradients():
    message = "gradients must be a Composite, got ndarray"
    refused(TypeError, message, composite_rays_backward, np.ones((4, 3)), **GOOD)
    message = "gradients must be a Composite, got tuple"
    refused(TypeError, message, composite_rays_backward, (None, None), **GOOD)
    for name, shape in (("color", (3,)), ("opacity", (3, 1)), ("distortion", (5,))):
        message = f"gradients.{name} must have shape {(3, 3) if name == 'color' else (3,)}"
        given = SEEN._replace(**{name: np.ones(shape)})
        refused(ValueError, f"{message}, got {shape}", composite_rays_backward, given, **GOOD)
    message = "gradients.depth must hold real numbers, got dtype complex128"
    given = SEEN._replace(depth=np.ones(3, complex))
    refused(TypeError, message, composite_rays_backward, given, **GOOD)


def test_captured_spans_on_a_gpu_are_not_looked_at(monkeypatch):
    """What a capture would have to wait for is refused by name."""
    monkeypatch.setattr("cvkern.radiance.compositing.device", lambda array: "cuda:0")
    message = "captured functions must be kernels alone, got a value needed on the host"
    refused(ValueError, message, cvkern.capture, composite_rays, *GOOD.values())
