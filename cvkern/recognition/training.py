"""Learning of a shape model: words, their occurrences, and the evidence that tells objects."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.recognition import FACTOR_BITS, FINE, NOBODY, OCTAVE, ONE, UNIT, Frame
from cvkern.recognition._kept import kept
from cvkern.recognition.patches import Places, Sampling, sample, scale_code
from cvkern.recognition.votes import activate

if TYPE_CHECKING:
    import scipy.sparse

LARGEST_WEIGHT = 8 * UNIT
MOST_PLACES = 32  # occurrences of a word that are kept
MERGED = 2 * FINE  # places of occurrences are rounded to this
MOST_TRAINED = 100_000  # patches that are clustered
PENALTY = 1e-3  # factor of the squares of weights
STEPS = 60  # steps of the solver
MOST_LAYERS = 3
MOST_SIZE = 512  # pixels of a side of the model's box
CELL_SIDE = 16  # half pixels of the model, roughly, along the side of a cell of evidence
ROUNDS = 3  # times that weights are learnt, each time with what was mistaken before
ZOOMS = (0.7, 1.0, 1.4)  # sizes at which negatives are looked at
WINDOW_STEP = 4 * FINE  # between places at which negatives are looked at
DOUBTFUL = -1.5  # evidence above which a place in a negative is learnt from
HARDEST = 20  # places of a negative that are learnt from in a round
SEEN = 2.0  # pixels of a patch that may be hidden, where half of an object is
SPREAD_RARE = 0.05  # activations added to those of a word in negatives


class Settings(NamedTuple):
    """What a model is made with."""

    words: int
    method: str
    correlation: float
    most: int
    sampling: Sampling
    height: int
    width: int
    layers: int
    """Sizes of patches, each twice the one before."""

    @property
    def least(self) -> int:
        """Least product of a patch and a word that it activates."""
        return int(np.ceil(self.correlation * self.sampling.norm))

    @property
    def middle(self) -> np.ndarray:
        """Row and column of the middle of the box, from its first pixel, in parts of a pixel."""
        return FINE * np.array([self.height - 1, self.width - 1]) // 2

    @property
    def frame(self) -> Frame:
        """Where the centres of patches lie that are within the box of an object."""
        side, step = self.sampling.side, self.sampling.step
        layers, cells = [], 0
        for layer in range(self.layers):
            zoom = 2**layer
            high, wide = (
                max(2 * n // zoom - 2 * side + step, step) for n in (self.height, self.width)
            )
            down, along = (max(1, round(n / CELL_SIDE)) for n in (high, wide))
            layers.append((FINE * high // 4, FINE * wide // 4, down, along, OCTAVE * layer, cells))
            cells += down * along
        whole = (FINE * self.height // 2, FINE * self.width // 2)
        return Frame(np.array(layers, np.int32), *whole)

    @property
    def cells(self) -> int:
        """Number of cells of evidence."""
        _, _, down, along, _, first = self.frame.layers[-1].tolist()
        return first + down * along

    def sizes(self, scales: tuple[float, ...]) -> tuple[float, ...]:
        """Return the scales of all patches that objects of these scales are looked for by."""
        return tuple(sorted({s * 2**layer for s in scales for layer in range(self.layers)}))


@lru_cache(maxsize=32)
def frame_of(settings: Settings) -> Frame:
    """Return the frame of a model, on the host."""
    return settings.frame


class Example(NamedTuple):
    """The patches of a picture, on the host."""

    places: Places
    patches: np.ndarray
    """Patches (N, D) int8, if they have no words yet."""
    level: np.ndarray
    """Level of each patch, (N,)."""
    matches: np.ndarray
    """Words of each patch, (N, M) int32."""


class Window(NamedTuple):
    """Words of the patches in a frame, and the cells that they lie in."""

    words: np.ndarray
    cells: np.ndarray
    low: np.ndarray
    """First pixels of the patches along the longer side of the box, from its middle."""
    high: np.ndarray


Factors = Callable[[int], int]


class Learnt(NamedTuple):
    """Weights of evidence, and the constant that is added to their sum."""

    weights: np.ndarray
    bias: int


def look(
    rt: Runtime,
    image: np.ndarray,
    settings: Settings,
    words: np.ndarray | None,
    scales: tuple[float, ...] = (1.0,),
    first: tuple[int, int] = (0, 0),
) -> Example:
    """Return the patches of a picture from a first pixel on, and their words if there are any."""
    image = np.ascontiguousarray(image[first[0] :, first[1] :])
    places, patches = sample(rt, image, 1.0, settings.sizes(scales), settings.sampling)
    count = len(places.places)
    level = np.zeros(count, np.int32)
    for number, (_, begin, end) in enumerate(places.levels.tolist()):
        if begin < end:
            level[places.rows[begin, 1] : places.rows[end - 1, 2]] = number
    matches, own = np.empty((count, 0), np.int32), np.empty((0, 0), np.int8)
    if words is None:
        own = np.array(rt.to_numpy(patches))
    elif count:
        matches = rt.scratch("recognition.matches", (count, settings.most), np.int32)
        activate(rt, patches, kept(rt, words), settings.least, matches)
        matches = np.array(rt.to_numpy(matches))
    shift = FINE * np.array([*first, 0], np.int32)
    rows = places.rows + shift[[0, 2, 2]]
    moved = places._replace(places=places.places + shift, rows=rows)
    return Example(moved, own, level, matches)


def occurrences_of(
    examples: list[Example], masks: list[np.ndarray | None], settings: Settings, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return starts and entries of the occurrences of `count` words, and their mean masks.

    Weights of a word add up to `ONE`, or a little less after rounding.
    """
    side = settings.sampling.side
    middle = settings.middle
    found, figures = [], []
    for example, mask in zip(examples, masks, strict=True):
        patch, _ = active = np.nonzero(example.matches != NOBODY)
        places = example.places.places[patch]
        own = 2.0 ** (places[:, 2:] / OCTAVE)  # offsets are in pixels of the patch
        offset = np.rint((middle - places[:, :2]) / own / MERGED) * MERGED
        row = [example.matches[active], offset, -places[:, 2]]
        found.append(np.column_stack(row).astype(np.int64))
        if mask is not None:
            corner = np.rint(places[:, :2] / FINE - (side - 1) / 2).astype(np.int64)
            seen = np.lib.stride_tricks.sliding_window_view(mask, (side, side))
            # The masks of larger patches are not used.
            row, column = (corner[:, i].clip(0, seen.shape[i] - 1) for i in (0, 1))
            figures.append(seen[row, column].reshape(len(patch), side * side))
    rows, of, seen = np.unique(
        np.concatenate(found), axis=0, return_inverse=True, return_counts=True
    )
    kept = most_frequent(rows[:, 0], seen)
    of_word = rows[kept, 0]
    totals = np.bincount(of_word, weights=seen[kept], minlength=count)
    weights = np.floor(ONE * seen[kept] / totals[of_word])
    entries = np.column_stack([rows[kept, 1:], weights]).astype(np.int32)
    starts = np.searchsorted(of_word, np.arange(count + 1)).astype(np.int32)
    if not figures:
        return starts, entries, None
    import scipy.sparse

    sums = scipy.sparse.csr_matrix(
        (np.ones(len(of)), (of.reshape(-1), np.arange(len(of)))), (len(rows), len(of))
    ) @ np.concatenate(figures).astype(np.float64)
    return starts, entries, np.rint(255 * sums / seen[:, None])[kept].astype(np.uint8)


def most_frequent(words: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the `MOST_PLACES` entries of each word that were seen most, in their order."""
    order = np.lexsort((np.arange(len(words)), -seen, words))
    first = np.searchsorted(words[order], words[order])
    return np.sort(order[np.arange(len(words)) - first < MOST_PLACES])


def window_at(example: Example, place: np.ndarray, factors: Factors, settings: Settings) -> Window:
    """Return the matches inside the frame at a place (row, column, scale), as kernels find them."""
    seen, side = example.places, settings.sampling.side
    axis = int(settings.width >= settings.height)
    parts = []
    for layer, (high, wide, down, along, offset, first) in enumerate(frame_of(settings).layers):
        half = np.array([high, wide])
        codes = seen.levels[:, 0]
        level = int(np.abs(codes - place[2] - offset).argmin())
        apart = seen.places[:, :2].astype(np.int64) - place[:2]
        u = (apart << FACTOR_BITS) // factors(int(codes[level])) + half
        inside = ((u >= 0) & (u < 2 * half)).all(axis=1) & (example.level == level)
        patch = np.flatnonzero(inside)
        cell = u[patch] * (down, along) // (2 * half)
        cell = first + cell[:, 0] * along + cell[:, 1]
        middle = (u[patch, axis] - half[axis]) / FINE * 2**layer
        reach = side / 2 * 2**layer
        row, column = np.nonzero(example.matches[patch] != NOBODY)
        words = example.matches[patch[row], column]
        parts.append(Window(words, cell[row], middle[row] - reach, middle[row] + reach))
    return Window(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def surprise(windows: list[Window], count: int, cells: int) -> np.ndarray:
    """Return the logarithm of how much more often a word is in a cell than any word, if more."""
    seen = np.zeros((count, cells))
    for window in windows:
        np.add.at(seen, (window.words, window.cells), 1)
    share = (seen + 1 / count) / (seen.sum(axis=0) + 1)
    return np.log(share * count).clip(0)


def columns(windows: list[Window], count: int, cells: int) -> scipy.sparse.csr_matrix:
    """Return the windows as rows of counts of (word, cell)."""
    import scipy.sparse

    of = np.repeat(np.arange(len(windows)), [len(w.words) for w in windows])
    key = np.concatenate([w.words * cells + w.cells for w in windows] or [np.empty(0, int)])
    shape = (len(windows), count * cells)
    return scipy.sparse.csr_matrix((np.ones(len(key)), (of, key)), shape)


def halves(windows: list[Window]) -> list[Window]:
    """Return each window whole, with its left half hidden, and with its right half hidden."""
    found = list(windows)
    for window in windows:
        for seen in (window.high <= SEEN, window.low >= -SEEN):
            found.append(Window(*(part[seen] for part in window)))
    return found


def separate(objects: Any, others: Any) -> tuple[np.ndarray, float]:
    """Return weights and bias of logistic regression, both classes of equal weight."""
    import scipy.optimize
    import scipy.sparse

    matrix = scipy.sparse.vstack([objects, others]).tocsr()
    across: Any = matrix.T.tocsr()
    count = len(objects.indptr) - 1, len(others.indptr) - 1
    sign = np.r_[np.ones(count[0]), -np.ones(count[1])]
    share = np.r_[np.full(count[0], 1 / count[0]), np.full(count[1], 1 / max(count[1], 1))]

    def loss(solution: np.ndarray) -> tuple[float, np.ndarray]:
        margin = sign * (matrix @ solution[:-1] + solution[-1])
        slope = -sign * share * np.exp(-np.logaddexp(0, margin))
        gradient = np.r_[across @ slope + PENALTY * solution[:-1], slope.sum()]
        size = PENALTY / 2 * (solution[:-1] ** 2).sum()
        return float((share * np.logaddexp(0, -margin)).sum() + size), gradient

    start = np.zeros(across.shape[0] + 1)
    found: Any = scipy.optimize.minimize(
        loss, start, jac=True, method="L-BFGS-B", options={"maxiter": STEPS}
    )
    return found.x[:-1], float(found.x[-1])


def quantised(weights: np.ndarray, bias: float, count: int) -> Learnt:
    """Return weights (K, cells) and bias as integers."""
    whole = np.rint(weights * UNIT).clip(-LARGEST_WEIGHT, LARGEST_WEIGHT).astype(np.int32)
    return Learnt(whole.reshape(count, -1), round(bias * UNIT))


def dense_modes(shape: tuple[int, ...], settings: Settings, scale: float) -> np.ndarray:
    """Return places (T, 4) all over a picture where an object of a size would be inside."""
    spans = []
    for side, size in zip(shape, (settings.height, settings.width), strict=True):
        half = FINE * size * scale / 2
        spans.append(np.arange(half, max(FINE * side - half, half + 1), WINDOW_STEP * scale))
    y, x = (np.rint(a.ravel()) for a in np.meshgrid(*spans, indexing="ij"))
    scales = np.full(len(y), scale_code(scale))
    return np.column_stack([y, x, scales, np.ones(len(y))]).astype(np.int32)
