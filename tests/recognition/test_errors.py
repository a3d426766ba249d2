"""Wrong arguments of recognition are refused by name."""

import numpy as np
import pytest

import cvkern
from tests.recognition.alphabet import clutter, thing, things


def refused(error, said, function, *args, **options):
    """Check how a message begins."""
    with pytest.raises(error) as info:
        function(*args, **options)
    assert str(info.value).startswith(said)


PATCHES = np.random.default_rng(0).random((5, 8, 8))


@pytest.mark.parametrize(
    ("patches", "options", "error", "said"),
    [
        (PATCHES[0], {}, ValueError, "patches must be 3-D"),
        (PATCHES[:, :, :7], {}, ValueError, "patches must have shape (N, S, S)"),
        (np.ones((2, 7, 7)), {}, ValueError, "patches must have shape (N, S, S)"),
        (np.ones((2, 8, 8)), {}, ValueError, "patches must have one that is not flat"),
        (PATCHES.astype(complex), {}, TypeError, "patches must hold real numbers"),
        (PATCHES, {"method": "mean"}, ValueError, "method must be one of"),
        (PATCHES, {"words": 0}, ValueError, "words must be in [1, 65536], got 0"),
        (PATCHES, {"words": 2.5}, TypeError, "words must be an integer"),
        (PATCHES, {"threshold": 0}, ValueError, "threshold must be in (0, 1], got 0"),
        (PATCHES, {"data_range": -1}, ValueError, "data_range must be > 0, got -1"),
    ],
)
def test_codebooks(patches, options, error, said):
    refused(error, said, cvkern.learn_codebook, patches, **options)


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"words": 0}, ValueError, "words must be in"),
        ({"patch": 7}, ValueError, "patch must be in [8, 25], got 7"),
        ({"points": "all"}, ValueError, "points must be one of"),
        ({"step": 0}, ValueError, "step must be in"),
        ({"method": "auto"}, ValueError, "method must be one of"),
        ({"correlation": 1.5}, ValueError, "correlation must be in (0, 1], got 1.5"),
        ({"layers": 4}, ValueError, "layers must be in [1, 3], got 4"),
        ({"max_words": 9}, ValueError, "max_words must be in [1, 8], got 9"),
        ({"size": 9}, ValueError, "size must be in [16, 512], got 9"),
        ({"mirror": "yes"}, TypeError, "mirror must be True or False"),
    ],
)
def test_models(options, error, said):
    refused(error, said, cvkern.ShapeModel, **options)


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ({"images": []}, ValueError, "images must have at least one picture"),
        ({"images": 5}, TypeError, "images must be a sequence of pictures"),
        ({"images": [np.zeros(3)]}, ValueError, "images[0] must be 2-D or 3-D"),
        ({"images": [np.zeros((30, 30, 2))]}, ValueError, "images[0] must have 3 or 4 channels"),
        ({"boxes": []}, ValueError, "boxes must be of 1 pictures, got 0"),
        ({"boxes": [[]]}, ValueError, "boxes must have at least one object"),
        ({"boxes": [[[0, 0, 9]]]}, ValueError, "boxes[0] must have shape (N, 4)"),
        ({"boxes": [[[0, 0, 99, 9]]]}, ValueError, "boxes[0] must be within the picture"),
        ({"boxes": [[[0, 0, 0, 9]]]}, ValueError, "boxes[0] must be within the picture"),
        ({"boxes": [[[0, 0, 9, np.nan]]]}, ValueError, "boxes[0] must be finite"),
        ({"boxes": [[[0, 0, 20, 8]]]}, ValueError, "patch must be at most 8 for 1 layers"),
        ({"masks": []}, ValueError, "masks must be of 1 pictures, got 0"),
        ({"masks": [np.zeros((3, 3))]}, ValueError, "masks[0] must have shape (32, 48)"),
        ({"negatives": [np.zeros(3)]}, ValueError, "negatives[0] must be 2-D or 3-D"),
        ({"data_range": 0}, ValueError, "data_range must be > 0"),
    ],
)
def test_fitting(arguments, error, said):
    model = cvkern.ShapeModel(20)
    refused(error, said, model.fit, **{"images": [thing()], **arguments})
    assert model.box is None


def test_objects_that_show_nothing():
    with pytest.raises(ValueError, match="images must have patches that are not flat"):
        cvkern.ShapeModel(20).fit([np.zeros((30, 40))])


def test_words_that_no_patch_activates():
    model = cvkern.ShapeModel(20, patch=12, step=3, correlation=1.0)
    model.fit(things(2), negatives=[clutter((60, 90), 1)])
    assert len(model.detect(things(1)[0]).scores) == 0


def test_detection():
    model = cvkern.ShapeModel(20)
    image = np.zeros((40, 50))
    refused(ValueError, "the model must be fitted or loaded first", model.detect, image)
    with pytest.raises(ValueError, match="the model must be fitted"):
        model.save("model.npz")
    model.fit(things(1))
    for options, error, said in [
        ({"scales": []}, ValueError, "the number of scales must be in [1, 64], got 0"),
        ({"scales": 1.0}, TypeError, "scales must be a sequence of numbers"),
        ({"scales": [0.0]}, ValueError, "scales must be > 0"),
        ({"scales": [20.0]}, ValueError, "scales must be in [0.0625, 16]"),
        ({"threshold": np.nan}, ValueError, "threshold must be finite"),
        ({"data_range": 0}, ValueError, "data_range must be > 0"),
    ]:
        refused(error, said, model.detect, image, **options)
    refused(ValueError, "image must be 2-D or 3-D", model.detect, np.zeros(5))
    refused(ValueError, "image must have 3 or 4 channels", model.detect, np.zeros((9, 9, 2)))
