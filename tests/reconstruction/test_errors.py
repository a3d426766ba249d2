"""Wrong arguments are refused before any kernel runs."""

import numpy as np
import pytest

import cvkern
from tests.reconstruction import scenes

IMAGES = [np.zeros((20, 30), np.uint8)] * 2
CAMERA = cvkern.Camera([[30, 0, 15], [0, 30, 10], [0, 0, 1]], shape=(20, 30))
FAR = cvkern.Camera([[1e30, 0, 15], [0, 1e30, 10], [0, 0, 1]], shape=(20, 30))


@pytest.mark.parametrize(
    ("given", "options", "error", "text"),
    [
        ([IMAGES[0]], {}, ValueError, "images must be at least two, got 1"),
        ([], {}, ValueError, "images must not be empty"),
        (5, {}, TypeError, "images must be a sequence of arrays"),
        ([IMAGES[0], np.zeros((4, 4, 2))], {}, ValueError, r"images\[1\] must have 1, 3 or 4"),
        (IMAGES, {"lens": "both"}, ValueError, "lens must be one of"),
        (IMAGES, {"refine": 2}, TypeError, "refine must be True or False"),
        (IMAGES, {"seed": -1}, ValueError, "seed must be in"),
        (IMAGES, {"max_keypoints": 0}, ValueError, "max_keypoints must be in"),
        (IMAGES, {"data_range": 0}, ValueError, "data_range must be > 0"),
        (IMAGES, {"names": ["a"]}, ValueError, "names must be 2 different ones"),
        (IMAGES, {"names": ["a", "a"]}, ValueError, "names must be 2 different ones"),
        (IMAGES, {"names": ["a", "b\n"]}, ValueError, "names must be lines of text"),
        (IMAGES, {"names": [1, 2]}, TypeError, "names must be strings"),
        (IMAGES, {"cameras": [CAMERA]}, ValueError, "cameras must be one, or 2, got 1"),
        (IMAGES, {"cameras": [CAMERA, 3]}, TypeError, r"cameras\[1\] must be a Camera"),
        (IMAGES, {"cameras": scenes.camera()}, ValueError, r"cameras\[0\] must be for an image"),
        (IMAGES, {"cameras": FAR}, ValueError, r"cameras\[0\]\.matrix must have an inverse"),
        (IMAGES, {"focal_lengths": 1e-320}, ValueError, "focal_lengths must be in "),
        (IMAGES, {"focal_lengths": 1e300}, ValueError, "focal_lengths must be in "),
        (IMAGES, {"focal_lengths": [3, 4, 5]}, ValueError, "focal_lengths must be one, or 2"),
        (IMAGES, {"focal_lengths": 9, "cameras": CAMERA}, ValueError, "must not be given with"),
        (IMAGES, {"pairs": "near"}, ValueError, "pairs must be one of"),
        (IMAGES, {"pairs": [[0.5, 1.0]]}, TypeError, "pairs must be integers"),
        (IMAGES, {"pairs": [0, 1]}, ValueError, r"pairs must have shape \(P, 2\)"),
        (IMAGES, {"pairs": [[1, 1]]}, ValueError, "pairs must be two different images of 2"),
        (IMAGES, {"neighbors": 0}, ValueError, "neighbors must be in"),
        (IMAGES, {"models": "both"}, ValueError, "models must be one of"),
        (IMAGES, {"journal": 3}, TypeError, "journal must be a string or a path"),
        ("/nowhere", {}, FileNotFoundError, "images must be a folder that exists"),
    ],
)
def test_reconstruct(given, options, error, text, no_kernel_runs):
    with pytest.raises(error, match=text):
        cvkern.reconstruct(given, **options)


def bundle(**other):
    scene = scenes.make(count=2, points=5)
    given = {
        "poses": scene.poses, "lenses": scene.camera, "points": scene.points,
        "tracks": scene.tracks, "places": scene.places,
    }  # fmt: skip
    return given | other


@pytest.mark.parametrize(
    ("other", "error", "text"),
    [
        ({"poses": np.eye(3)}, ValueError, r"poses must have shape \(N, 3, 4\)"),
        ({"poses": np.full((2, 3, 4), np.nan)}, ValueError, "poses must be finite"),
        ({"poses": np.ones((2, 3, 4))}, ValueError, "poses must have rotations"),
        ({"lenses": []}, ValueError, "lenses must not be empty"),
        ({"lenses": [scenes.camera()] * 3}, ValueError, "lenses must be one, or 2"),
        ({"lenses": [4]}, TypeError, r"lenses\[0\] must be a Camera"),
        ({"lens_of": [0, 1]}, ValueError, "lens_of must be indices that exist"),
        ({"lens_of": [0.0, 0.0]}, TypeError, "lens_of must be integers"),
        ({"lens_of": []}, TypeError, "lens_of must be integers"),
        ({"points": np.ones((5, 2))}, ValueError, r"points must have shape \(N, 3\)"),
        ({"points": np.full((5, 3), np.inf)}, ValueError, "points must be finite"),
        ({"places": np.ones((3, 2))}, ValueError, r"tracks must have shape \(3, 2\)"),
        ({"tracks": np.full((10, 2), 7)}, ValueError, "tracks must be indices that exist"),
        ({"tracks": np.zeros((10, 2), int)}, ValueError, "each point of a photograph once"),
        ({"fixed": [True]}, ValueError, r"fixed must be bool of shape \(2,\)"),
        ({"refine": "lens"}, ValueError, "refine must be one of"),
        ({"loss": "l1"}, ValueError, "loss must be one of"),
        ({"scale": 0}, ValueError, "scale must be > 0"),
        ({"max_steps": -1}, ValueError, "max_steps must be in"),
    ],
)
def test_adjust_bundle(other, error, text, no_kernel_runs):
    given = bundle(**other)
    if len(given["tracks"]) != len(given["places"]) and "places" not in other:
        given["tracks"] = given["tracks"][: len(given["places"])]
        given["tracks"] = np.resize(other["tracks"], (len(given["places"]), 2))
    with pytest.raises(error, match=text):
        cvkern.adjust_bundle(**given)
