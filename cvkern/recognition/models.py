"""An implicit shape model: learnt from pictures of objects, it finds them in other pictures."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._checks import check_choice, check_flag, check_integer, check_number
from cvkern._runtime import runtime
from cvkern.kernels.codes.recognition import MOST_WORDS
from cvkern.recognition import files
from cvkern.recognition._arguments import Box, check_boxes, check_masks, cut_all, grays_of
from cvkern.recognition.codebook import METHODS, MOST_CODEBOOK
from cvkern.recognition.figures import Objects, Segmentation, masks_of, objects_of
from cvkern.recognition.fitting import Fitted, fit
from cvkern.recognition.patches import LEAST_SIDE, MOST_SIDE, MOST_STEP, POINTS, Sampling
from cvkern.recognition.search import search, votes_of
from cvkern.recognition.training import MOST_LAYERS, MOST_SIZE, Settings

LONGEST = 96  # pixels of the longer side of the model's box, at most unless asked


class ShapeModel:
    """Find objects by patches that vote for their centres: an implicit shape model.

    Parameters
    ----------
    words : int, default 1000
        Number of visual words that `kmeans` looks for.
    patch : int, default 16
        Side of a patch, pixels of the model; 8 to 25.
    points : {'grid', 'harris', 'dog'}, default 'grid'
        Where patches are: on a grid, at Harris corners, or at the keypoints of :func:`sift`.
    step : int, default 4
        Pixels between the points of the grid; the least distance of Harris corners.
    method : {'kmeans', 'agglomerative'}, default 'kmeans'
        How words are found, see :func:`learn_codebook`.
    correlation : float, default 0.5
        A patch activates words that correlate with it by at least this, in (0, 1]. It is also the
        threshold of `agglomerative`.
    max_words : int, default 5
        Number of words that a patch activates, at most 8: those that correlate best.
    layers : int, optional
        Sizes of patches, 1 to 3: each layer has patches of twice the size, in an image of half the
        size. By default 2, or 1 if the box of the model has no room for the larger patches.
    size : int, optional
        Longer side of the model's box, pixels. By default that of the median box, at most 96.
    mirror : bool, default True
        Learn from mirrored objects too.

    Attributes
    ----------
    box : (int, int) or None
        Height and width of an object of scale 1, pixels.
    threshold : float or None
        Least score of what :meth:`detect` finds by default.
    words : array of shape (K, S, S), int8, or None
        Visual words.
    has_masks : bool
        Whether the model was fitted with masks, for :meth:`segment`.

    Raises
    ------
    TypeError
        If an option is of a wrong type.
    ValueError
        If an option is unknown or out of its range.

    Notes
    -----
    Patches are normalised and rounded to integers, and correlated with all words. The words of a
    patch vote for the centre and the scale of an object, by where they were seen in training. The
    weights of a patch add up to 1, the share of the background included. Maxima of the votes move
    to modes of their density by mean shift, with a kernel that grows with the scale. At each mode,
    the words in the cells of the box are weighed: the sum is the logarithm of the odds. Modes move
    by some pixels to where it is largest. Hypotheses share the patches by minimum description
    length: each patch is explained once.

    Votes, places and scores are integers or fractions of integers: the same on every device.

    References
    ----------
    .. [1] B. Leibe, A. Leonardis and B. Schiele, "Robust object detection with interleaved
       categorization and segmentation", IJCV 77, 2008.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> y, x = np.mgrid[:32, :32]
    >>> ring = np.abs(np.hypot(y - 15.5, x - 15.5) - 10) < 3.0
    >>> model = cvkern.ShapeModel(words=50, patch=8).fit([ring])
    >>> photo = np.zeros((80, 90))
    >>> photo[20:52, 40:72] = ring
    >>> found = model.detect(photo, scales=[1.0])
    >>> found.boxes.shape, bool(np.abs(found.boxes - [20, 40, 52, 72]).max() < 2)
    ((1, 4), True)
    """

    def __init__(
        self,
        words: int = 1000,
        *,
        patch: int = 16,
        points: str = "grid",
        step: int = 4,
        method: str = "kmeans",
        correlation: float = 0.5,
        max_words: int = 5,
        layers: int | None = None,
        size: int | None = None,
        mirror: bool = True,
    ):
        self._words = check_integer(words, "words", 1, MOST_CODEBOOK)
        side = check_integer(patch, "patch", LEAST_SIDE, MOST_SIDE)
        check_choice(points, POINTS, "points")
        step = check_integer(step, "step", 1, MOST_STEP)
        self._method = check_choice(method, METHODS[1:], "method")
        self._correlation = check_number(correlation, "correlation")
        if not 0 < self._correlation <= 1:
            raise ValueError(f"correlation must be in (0, 1], got {self._correlation:g}")
        self._most = check_integer(max_words, "max_words", 1, MOST_WORDS)
        self._size = None if size is None else check_integer(size, "size", side, MOST_SIZE)
        self._layers = layers if layers is None else check_integer(layers, "layers", 1, MOST_LAYERS)
        self._mirror = check_flag(mirror, "mirror")
        self._sampling = Sampling(side, points, step)
        self._settings: Settings | None = None
        self._fitted: Fitted | None = None

    @property
    def box(self) -> tuple[int, int] | None:
        """Height and width of an object of scale 1, pixels."""
        return None if self._settings is None else (self._settings.height, self._settings.width)

    @property
    def threshold(self) -> float | None:
        """Least score of an object, by default."""
        return None if self._fitted is None else self._fitted.threshold

    @property
    def has_masks(self) -> bool:
        """Whether the model was fitted with masks, for :meth:`segment`."""
        return self._fitted is not None and self._fitted.figures.size > 0

    def fit(
        self,
        images: Sequence[Any],
        boxes: Sequence[Any] | None = None,
        masks: Sequence[Any] | None = None,
        negatives: Sequence[Any] | None = None,
        *,
        data_range: float | None = None,
    ) -> ShapeModel:
        """Learn from pictures of objects.

        Parameters
        ----------
        images : sequence of arrays of shape (H, W), (H, W, 3) or (H, W, 4)
            Pictures with objects; sizes may differ.
        boxes : sequence of arrays of shape (N, 4), optional
            Boxes of the objects of each picture: first row and column, and those behind the last.
            By default each picture is one object.
        masks : sequence of arrays of shape (H, W), optional
            Pixels of objects are not 0; for :meth:`segment`.
        negatives : sequence of arrays of shape (H, W), (H, W, 3) or (H, W, 4), optional
            Pictures without objects, as counterexamples. Small ones are mirrored at their borders.
        data_range : float, optional
            The value of white. By default 255 for bytes and 1 for floating-point images; for wider
            integers, and floating-point images with a mean above 1, the smallest of 2^8 - 1,
            2^10 - 1, 2^12 - 1 and so on that no value exceeds.

        Returns
        -------
        ShapeModel
            The model itself.

        Raises
        ------
        TypeError
            If a picture or a mask does not hold real numbers.
        ValueError
            If shapes do not agree, boxes are not within their pictures, or nothing is to be learnt.
        """
        pictures = grays_of(images, "images", data_range)
        if not pictures:
            raise ValueError("images must have at least one picture, got none")
        spans = check_boxes(boxes, pictures)
        figures = None if masks is None else check_masks(masks, pictures)
        others = grays_of(() if negatives is None else negatives, "negatives", data_range)
        height, width, zoom = self._model_box([box for found in spans for box in found])
        layers = self._layers or (2 if min(height, width) // 2 >= self._sampling.side else 1)
        least = min(height, width) >> (layers - 1)
        if least < self._sampling.side:
            raise ValueError(
                f"patch must be at most {least} for {layers} layers in the model's box of "
                f"{height} x {width}, got {self._sampling.side}"
            )
        settings = Settings(
            self._words, self._method, self._correlation, self._most, self._sampling, height, width,
            layers,
        )  # fmt: skip
        objects = cut_all(pictures, spans, (height, width))
        shown = None if figures is None else cut_all(figures, spans, (height, width)) > 0.5
        if self._mirror:
            objects = np.concatenate([objects, objects[:, :, ::-1]])
            shown = None if shown is None else np.concatenate([shown, shown[:, :, ::-1]])
        learnt = fit(runtime(), objects, shown, others, settings)
        self._fitted = learnt._replace(usual=1 / zoom)
        self._settings = settings
        return self

    def _model_box(self, boxes: list[Box]) -> tuple[int, int, float]:
        """Return height and width of the model's box, and its size over that of the median box."""
        sides = np.array([(b[2] - b[0], b[3] - b[1]) for b in boxes], np.float64)
        height, width = np.median(sides, axis=0)
        longer = self._size or min(max(height, width), LONGEST)
        zoom = longer / max(height, width)
        return max(round(height * zoom), 1), max(round(width * zoom), 1), zoom

    def detect(
        self,
        image: Any,
        *,
        scales: Sequence[float] | None = None,
        threshold: float | None = None,
        data_range: float | None = None,
    ) -> Objects:
        """Find objects in a picture.

        Parameters
        ----------
        image : array of shape (H, W), (H, W, 3) or (H, W, 4)
            Any real dtype.
        scales : sequence of float, optional
            Sizes of objects to look for, in sizes of the model. By default 0.71, 0.84, 1, 1.19 and
            1.41 times the median object of the training, which has scale 1 unless `size` or the
            limit of 96 pixels made the model another size.
        threshold : float, optional
            Least score; by default that of the model.
        data_range : float, optional
            The value of white. By default 255 for bytes and 1 for floating-point images; for wider
            integers, and floating-point images with a mean above 1, the smallest of 2^8 - 1,
            2^10 - 1, 2^12 - 1 and so on that no value exceeds.

        Returns
        -------
        Objects
            Named tuple of `boxes` (N, 4), `scores` (N,), `centers` (N, 2) and `scales` (N,), all
            float32, the strongest first.

        Raises
        ------
        TypeError
            If `image` does not hold real numbers.
        ValueError
            If the model is not fitted, `image` has a wrong shape, or an option is out of range.
        """
        settings, fitted = self._ready()
        found = search(image, scales, threshold, data_range, settings, fitted)
        return objects_of(found, fitted.bias)

    def segment(
        self,
        image: Any,
        *,
        scales: Sequence[float] | None = None,
        threshold: float | None = None,
        data_range: float | None = None,
    ) -> Segmentation:
        """Find objects in a picture, and the pixels of each.

        The votes of an object are followed back to their patches: each adds the mask that its word
        had in training, with its weight. A pixel belongs to the object where more weight says so.

        Parameters
        ----------
        image, scales, threshold, data_range
            As in :meth:`detect`.

        Returns
        -------
        Segmentation
            Named tuple of `objects`, as :meth:`detect` returns them, and `masks` (N, H, W), bool.

        Raises
        ------
        TypeError
            If `image` does not hold real numbers.
        ValueError
            If the model is not fitted or was fitted without masks, or as in :meth:`detect`.
        """
        settings, fitted = self._ready()
        if not fitted.figures.size:
            raise ValueError("the model must be fitted with masks, got one without")
        found = search(image, scales, threshold, data_range, settings, fitted, painted=True)
        return Segmentation(objects_of(found, fitted.bias), masks_of(found))

    def votes(
        self,
        image: Any,
        *,
        scales: Sequence[float] | None = None,
        data_range: float | None = None,
    ) -> list[np.ndarray]:
        """Return the votes for centres of objects, to look at.

        Parameters
        ----------
        image, scales, data_range
            As in :meth:`detect`.

        Returns
        -------
        list of arrays of shape (rows, columns), int32
            The sums of weights in the cells of each scale, ascending, on the host. A cell has four
            pixels of the model on each side; 65536 is the weight of a patch.

        Raises
        ------
        TypeError, ValueError
            As in :meth:`detect`.
        """
        return votes_of(search(image, scales, None, data_range, *self._ready()))

    @property
    def words(self) -> np.ndarray | None:
        """Visual words: normalised patches, (K, S, S) int8."""
        if self._fitted is None:
            return None
        side = self._sampling.side
        return self._fitted.words[:, : side * side].reshape(-1, side, side).copy()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to a file, whole or not at all.

        Parameters
        ----------
        path : path
            Ends in ``.npz``; a file that exists is replaced.

        Raises
        ------
        FileNotFoundError, PermissionError
            If the folder does not exist, or cannot be written to.
        ValueError
            If the model is not fitted, or `path` does not end in ``.npz``.
        """
        settings, fitted = self._ready()
        files.write(path, settings, fitted)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> ShapeModel:
        """Read a model that :meth:`save` wrote.

        Parameters
        ----------
        path : path
            A file of arrays; nothing in it is executed.

        Returns
        -------
        ShapeModel
            It finds what the saved one does.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        ValueError
            If it is not a shape model, has another version, or is incomplete or damaged.
        """
        settings, fitted = files.read(path)
        model = ShapeModel(
            settings.words,
            patch=settings.sampling.side,
            points=settings.sampling.points,
            step=settings.sampling.step,
            method=settings.method,
            correlation=settings.correlation,
            max_words=settings.most,
            layers=settings.layers,
            size=max(settings.height, settings.width),
        )
        model._settings, model._fitted = settings, fitted
        return model

    def _ready(self) -> tuple[Settings, Fitted]:
        if self._settings is None or self._fitted is None:
            raise ValueError("the model must be fitted or loaded first, got one that is not")
        return self._settings, self._fitted
