"""Objects are cut out of clutter by the masks that their patches had in training."""

import numpy as np
import pytest

import cvkern
from tests.recognition.alphabet import HEIGHT, WIDTH, clutter, thing

Y, X = np.mgrid[:HEIGHT, :WIDTH]
ROUND = ((Y - 15.5) / 14) ** 2 + ((X - 23.5) / 22) ** 2 < 1


def pasted(image, row, column, seed=0):
    """Put a round object into a scene, and return its pixels."""
    part = image[row : row + HEIGHT, column : column + WIDTH]
    part[ROUND] = thing(noise=0.05, seed=seed)[ROUND]
    mask = np.zeros(image.shape, bool)
    mask[row : row + HEIGHT, column : column + WIDTH] = ROUND
    return mask


def share(a, b):
    return (a & b).sum() / (a | b).sum()


@pytest.fixture(scope="module")
def model():
    pictures = [clutter((HEIGHT, WIDTH), seed) for seed in range(8)]
    for seed, picture in enumerate(pictures):
        pasted(picture, 0, 0, seed)
    with cvkern.use(backend="warp"):
        return cvkern.ShapeModel(100, patch=12, mirror=False).fit(
            pictures, masks=[ROUND] * 8, negatives=[clutter((90, 130), s) for s in range(20, 26)]
        )


def test_figures_and_ground(backend, model):
    image = clutter((100, 180), 77)
    truth = [pasted(image, 12, 20, 91), pasted(image, 50, 101, 92)]
    objects, masks = model.segment(image, scales=[1.0])
    assert masks.dtype == np.bool_
    assert masks.shape == (len(objects.boxes), *image.shape)
    for mask in truth:
        best = max(share(mask, found) for found in masks[:2])
        assert best > 0.8
    for a, b in zip(objects, model.detect(image, scales=[1.0]), strict=True):
        np.testing.assert_array_equal(a, b)


def test_larger_objects(backend, model):
    image = clutter((60, 90), 78)
    truth = pasted(image, 14, 20, 93)
    image, truth = (np.kron(a, np.ones((2, 2), a.dtype)) for a in (image, truth))
    objects, masks = model.segment(image, scales=[1.7, 2.0, 2.4])
    assert abs(objects.scales[0] - 2) < 0.2
    assert share(truth, masks[0]) > 0.75


def test_nothing_to_cut_out(backend, model):
    objects, masks = model.segment(np.full((50, 60), 0.5))
    assert objects.boxes.shape == (0, 4)
    assert masks.shape == (0, 50, 60)


def test_models_without_masks_and_colours(backend):
    model = cvkern.ShapeModel(20).fit([thing()])
    with pytest.raises(ValueError, match="the model must be fitted with masks"):
        model.segment(np.zeros((50, 60)))
