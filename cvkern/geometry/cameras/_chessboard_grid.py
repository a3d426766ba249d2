"""From saddles to the grid of a chessboard, on the host: some hundreds of points.

At a saddle two edges cross, and the line through the two bright squares lies between them. At the
next corner along an edge it is the line through the dark ones that does.
"""

from __future__ import annotations

import importlib
from typing import NamedTuple

import numpy as np

MOST_STEP = 1.5  # pixels from the pixel of the largest response to the saddle itself
BESIDE = 1.5  # pixels from an edge at which its two sides are looked at
LEAST_STEP = 0.3  # least step across an edge, as a share of the largest on the way
SAME = 2.0  # pixels between two places of one saddle
NEAREST = 24  # candidates that may be neighbours
MOST_TURN = 0.35  # radians that the axes of two neighbours are off a right angle
LEAST_BETWEEN = 0.12  # sine of twice the angle between an edge and those axes
MOST_STRENGTH = np.log(3.0)  # logarithm of the ratio of neighbours' strengths
MOST_BENT = 0.35  # share of the spacing that lenses bend a corner off the plane of the others
LEAST_KNOWN = 0.7  # share of a grid's corners that must be found before the rest is looked for
MOST_BESIDE = 0.5  # share of a line of corners beside a board, which then has this line as well
MOST_GAP = 0.3  # share of the spacing that such a corner may be off
GUESSED_FROM = 12  # known corners that tell where one is missing


class Saddles(NamedTuple):
    """Saddles of a smooth picture."""

    places: np.ndarray
    """(N, 2) float64, x and y."""
    axes: np.ndarray
    """(N,) float64: direction, modulo pi, of the line through the bright squares."""
    strengths: np.ndarray
    """(N,) float64: minus the determinant of the second derivatives."""


def describe(smooth: np.ndarray, points: np.ndarray) -> Saddles:
    """Find saddles near pixels (row, column) within the pixel; those that have none are left out.

    The quadric through 3 x 3 pixels has its saddle where its gradient is 0.
    """
    y, x = points.T
    inner = (y > 0) & (x > 0) & (y < smooth.shape[0] - 1) & (x < smooth.shape[1] - 1)
    y, x = y[inner], x[inner]

    def at(i: int, j: int) -> np.ndarray:
        return smooth[y + i, x + j].astype(np.float64)

    gx, gy = (at(0, 1) - at(0, -1)) / 2, (at(1, 0) - at(-1, 0)) / 2
    xx = at(0, 1) + at(0, -1) - 2 * at(0, 0)
    yy = at(1, 0) + at(-1, 0) - 2 * at(0, 0)
    xy = (at(1, 1) + at(-1, -1) - at(1, -1) - at(-1, 1)) / 4
    det = xx * yy - xy * xy
    saddle = det < 0
    det = np.where(saddle, det, -1.0)
    step = np.stack((xy * gy - yy * gx, xy * gx - xx * gy), axis=1) / det[:, None]
    kept = saddle & (np.abs(step).max(axis=1) < MOST_STEP)
    # Edges that are not square to each other lie at equal angles from this axis, though not where
    # the second derivative is 0: of a blurred crossing that has no trace.
    bright = np.arctan2(2 * xy, xx - yy) / 2
    places = np.stack((x, y), axis=1) + step
    return _apart(Saddles(places[kept], bright[kept], -det[kept]))


def _apart(saddles: Saddles) -> Saddles:
    """Keep the strongest of saddles that are one, the first of equal ones."""
    spatial = importlib.import_module("scipy.spatial")
    if len(saddles.places) < 2:
        return saddles
    order = np.argsort(-saddles.strengths, kind="stable")
    rank = np.argsort(order)
    pairs = spatial.cKDTree(saddles.places).query_pairs(SAME, output_type="ndarray")
    kept = np.ones(len(order), bool)
    kept[np.where(rank[pairs[:, 0]] < rank[pairs[:, 1]], pairs[:, 1], pairs[:, 0])] = False
    return Saddles(*(values[kept] for values in saddles))


def grids(saddles: Saddles, smooth: np.ndarray) -> list[dict[tuple[int, int], int]]:
    """Return the connected grids among saddles, the largest first: which is at (row, column)."""
    links = neighbours(saddles, smooth)
    # The ray of the other corner that leads back.
    own = np.arange(len(links))[:, None, None]
    back = (links[links] == own).argmax(axis=2).tolist()
    seen, found, table = set(), [], links.tolist()
    for start in np.flatnonzero((links >= 0).any(axis=1)).tolist():
        if start in seen:
            continue
        grid = _grown(table, back, start)
        seen.update(grid.values())
        if len(grid) > 3:
            found.append(grid)
    return sorted(found, key=len, reverse=True)


def neighbours(saddles: Saddles, smooth: np.ndarray) -> np.ndarray:
    """Return the next corner along each of four rays, (N, 4) int: -1 where there is none.

    Ray r lies within r and r + 1 right angles from the axis of the bright squares. Two are
    neighbours if each is the other's.
    """
    spatial = importlib.import_module("scipy.spatial")
    places, axes, strengths = saddles
    count = len(places)
    links = np.full((count, 4), -1)
    if count < 2:
        return links
    many = min(NEAREST + 1, count)
    near = spatial.cKDTree(places).query(places, many)[1][:, 1:]
    way = places[near] - places[:, None]
    angle = np.arctan2(way[..., 1], way[..., 0])
    # Bright squares lie at one corner where the dark ones lie at the next.
    fits = np.abs(np.log(strengths[near] / strengths[:, None])) < MOST_STRENGTH
    fits &= np.abs(np.sin(axes[near] - axes[:, None])) > np.cos(MOST_TURN)
    # An edge lies between the axes of the squares on either side.
    between = np.minimum(*(np.abs(np.sin(2 * (angle - a))) for a in (axes[:, None], axes[near])))
    fits &= between > LEAST_BETWEEN
    cost = np.hypot(way[..., 0], way[..., 1]) / np.maximum(between, LEAST_BETWEEN)
    quarter = np.floor((angle - axes[:, None]) % (2 * np.pi) / (np.pi / 2)).astype(int) % 4
    one, other = np.nonzero(fits)
    bright = np.where(quarter[one, other] % 2, 1.0, -1.0)
    fits[one, other] = _edges(smooth, places[one], way[one, other], bright)
    for ray in range(4):
        own = np.where(fits & (quarter == ray), cost, np.inf)
        best = own.argmin(axis=1)
        known = np.isfinite(own[np.arange(count), best])
        links[known, ray] = near[known, best[known]]
    back = np.where(links[..., None] >= 0, links[links], -2)  # (N, 4, 4)
    mutual = (back == np.arange(count)[:, None, None]).any(axis=2)
    return np.where(mutual, links, -1)


def _edges(
    smooth: np.ndarray, places: np.ndarray, ways: np.ndarray, bright: np.ndarray
) -> np.ndarray:
    """Tell along which ways one side stays brighter; +1 is the side that angles grow to."""
    from scipy.ndimage import map_coordinates

    across = np.stack((-ways[:, 1], ways[:, 0]), axis=1)
    across *= BESIDE * bright[:, None] / np.maximum(np.hypot(*ways.T), 1e-9)[:, None]
    steps = []
    for share in (0.3, 0.5, 0.7):
        middle = places + share * ways
        light, dark = (
            map_coordinates(smooth, (middle + side * across).T[::-1], order=1, mode="nearest")
            for side in (1, -1)
        )
        with np.errstate(invalid="ignore"):  # two infinite pixels have no step between them
            steps.append(light - dark)
    return np.min(steps, axis=0) > LEAST_STEP * np.abs(steps).max(axis=0)


def _grown(links: list[list[int]], back: list[list[int]], start: int) -> dict[tuple[int, int], int]:
    """Walk from one corner to all that are joined with it; corners that fit nowhere are left out.

    A corner is known with its ray along the rows; rows, columns follow each other as angles grow,
    so that no grid is mirrored.
    """
    steps = ((0, 1), (1, 0), (0, -1), (-1, 0))
    grid = {(0, 0): start}
    seen = {start}
    waiting = [(start, (0, 0), 0)]
    for corner, (i, j), ray in waiting:
        for turn, (di, dj) in enumerate(steps):
            along = (ray + turn) % 4
            other = links[corner][along]
            place = (i + di, j + dj)
            if other < 0 or other in seen or place in grid:
                continue
            grid[place] = other
            seen.add(other)
            waiting.append((other, place, (back[corner][along] - turn - 2) % 4))
    return grid


def found_board(
    grid: dict[tuple[int, int], int],
    places: np.ndarray,
    smooth: np.ndarray,
    shape: tuple[int, int],
) -> np.ndarray | None:
    """Return the corners (rows, columns, 2), x and y, of a board in a grid, or None.

    A few corners may be missing: they are searched for where their neighbours predict them. The
    grid must have one board of that shape, not several that overlap.
    """
    if len(grid) < LEAST_KNOWN * shape[0] * shape[1]:
        return None
    keys = np.array(list(grid))
    low = keys.min(axis=0)
    spread = keys.max(axis=0) - low + 1
    table = np.full((*spread, 2), np.nan)
    for (i, j), corner in grid.items():
        table[i - low[0], j - low[1]] = places[corner]
    found = []
    for turned in (False, True):
        # A quarter turn: rows run down, and columns run to the left.
        view = np.rot90(table) if turned else table
        if turned and shape[0] == shape[1]:
            break
        found += _windows(view, shape, smooth)
    most = max((count for count, _ in found), default=0)
    best = [board for count, board in found if count == most]
    if len(best) != 1 or not is_flat(best[0]):
        return None
    return _begun(best[0], smooth)


def is_flat(board: np.ndarray) -> bool:
    """Tell whether a homography and a lens explain the corners, as they do for a flat board."""
    from cvkern.geometry.fitting import fit_homography

    rows, columns = board.shape[:2]
    plane = np.indices((rows, columns)).reshape(2, -1).T
    try:
        matrix = fit_homography(plane, board.reshape(-1, 2)[:, ::-1])
    except ValueError:
        return False
    shown = np.column_stack((plane[:, ::-1], np.ones(len(plane)))) @ matrix.T
    off = np.hypot(*(shown[:, :2] / shown[:, 2:] - board.reshape(-1, 2)).T).reshape(rows, columns)
    return bool((off < MOST_BENT * spacings(board)).all())


def spacings(board: np.ndarray) -> np.ndarray:
    """Return the distance from each corner to its nearer neighbours, (rows, columns)."""
    ways = [np.gradient(board, axis=axis) for axis in (0, 1)]
    return np.minimum(*(np.hypot(way[..., 0], way[..., 1]) for way in ways))


def area(board: np.ndarray) -> float:
    """Return the area of a board, square pixels."""
    x, y = np.stack((board[0, 0], board[0, -1], board[-1, -1], board[-1, 0])).T
    return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2


def _windows(
    table: np.ndarray, shape: tuple[int, int], smooth: np.ndarray
) -> list[tuple[int, np.ndarray]]:
    """Return the parts of a table of corners that are boards, and how many were found in each."""
    rows, columns = shape
    more = [max(0, want - have) for want, have in zip(shape, table.shape, strict=False)]
    if max(more) > 1:  # one row of corners at an end may have been missed
        return []
    padded = np.pad(table, [(more[0],) * 2, (more[1],) * 2, (0, 0)], constant_values=np.nan)
    known = np.isfinite(padded[..., 0])
    counts = _sums(known, rows, columns)
    # The lines of corners beside each part, of which a board has none.
    around = np.pad(known, 1)
    flat, tall = _sums(around, 1, columns)[:, 1:-1], _sums(around, rows, 1)[1:-1]
    level = np.maximum(flat[: len(counts)], flat[rows + 1 :])
    upright = np.maximum(tall[:, : counts.shape[1]], tall[:, columns + 1 :])
    good = (counts >= LEAST_KNOWN * rows * columns) & (level < MOST_BESIDE * columns)
    boards = []
    for i, j in np.argwhere(good & (upright < MOST_BESIDE * rows)):
        board = _completed(padded[i : i + rows, j : j + columns], smooth)
        boards += [(int(counts[i, j]), board)] if board is not None else []
    return boards


def _sums(table: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Return the sum of each part of a table that has so many rows and columns."""
    total = np.pad(table.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    wide = total[:, columns:] - total[:, :-columns]
    return wide[rows:] - wide[:-rows]


def _completed(board: np.ndarray, smooth: np.ndarray) -> np.ndarray | None:
    """Return a board whose missing corners have been looked for, or None."""
    board = board.copy()
    missing = np.argwhere(~np.isfinite(board[..., 0]))
    for i, j in missing:
        guess, spacing = _guess(board, i, j)
        if guess is None:
            return None
        near = np.round(guess[::-1] + np.indices((3, 3)).reshape(2, -1).T - 1).astype(int)
        inside = (near > 0).all(axis=1) & (near < np.array(smooth.shape) - 1).all(axis=1)
        places = describe(smooth, near[inside]).places
        gaps = np.hypot(*(places - guess).T)
        if not len(gaps) or gaps.min() > MOST_GAP * spacing:
            return None
        board[i, j] = places[gaps.argmin()]
    return board


def _guess(board: np.ndarray, i: int, j: int) -> tuple[np.ndarray | None, float]:
    """Return where a corner should be, from a homography of the known ones about it."""
    from cvkern.geometry.fitting import fit_homography

    known = np.argwhere(np.isfinite(board[..., 0]))
    order = np.argsort(np.abs(known - (i, j)).sum(axis=1), kind="stable")[:GUESSED_FROM]
    known = known[order]
    try:
        matrix = fit_homography(known, board[known[:, 0], known[:, 1]][:, ::-1])
    except ValueError:
        return None, 0.0
    around = np.array([[j, i, 1], [j + 1, i, 1], [j, i + 1, 1]]) @ matrix.T
    places = around[:, :2] / around[:, 2:]
    return places[0], float(np.hypot(*(places[1:] - places[0]).T).min())


def _begun(board: np.ndarray, smooth: np.ndarray) -> np.ndarray:
    """Return the board as it is read: from the corner at which it begins, row by row."""
    rows, columns = board.shape[:2]
    turns = range(4) if rows == columns else (0, 2)
    dark = [is_dark_first(np.rot90(board, turn), smooth) for turn in turns]
    best = max(
        range(len(dark)),
        key=lambda n: (dark[n], *_heading(np.rot90(board, list(turns)[n]))),
    )
    return np.rot90(board, list(turns)[best])


def _heading(board: np.ndarray) -> tuple[float, float]:
    """Return how far to the right, then down, the rows of a board run."""
    x, y = (board[:, -1] - board[:, 0]).mean(axis=0)
    return round(float(x), 6), round(float(y), 6)


def is_dark_first(board: np.ndarray, smooth: np.ndarray) -> bool:
    """Tell whether the square outside the first corner, at the corner of the board, is dark."""
    middles = (board[1:, 1:] + board[:-1, :-1] + board[1:, :-1] + board[:-1, 1:]) / 4
    parity = np.indices(middles.shape[:2]).sum(axis=0).ravel() % 2
    middles = middles.reshape(-1, 2)
    if len(middles) == 1:  # the square beside the only one between the corners
        middles = np.concatenate((middles, middles + board[0, 1] - board[0, 0]))
        parity = np.array([0, 1])
    x, y = np.round(middles).astype(int).T
    light = smooth[y.clip(0, smooth.shape[0] - 1), x.clip(0, smooth.shape[1] - 1)]
    return bool(light[parity == 0].mean() < light[parity == 1].mean())
