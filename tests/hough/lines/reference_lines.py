"""Plain NumPy statements of votes for lines and of the steps after them."""

import numpy as np

from cvkern.kernels.codes.hough import DIRECTION_FACTOR, DIRECTIONS

NEAR_A_TIE = 1e-5  # bins: how near to a tie fixed point may decide otherwise


def bins(points, cosine, sine, constant):
    """Return ``x cosine + y sine + constant`` in float64, (N, T)."""
    y, x = np.asarray(points, np.float64).T
    return np.multiply.outer(x, cosine) + np.multiply.outer(y, sine) + constant


def least_and_most(places, rows, allowed=None, weights=None):
    """Return votes (rows, T) without, and those with, what may go to either side of a tie."""
    angles = places.shape[1]
    weights = np.ones(len(places), np.int64) if weights is None else weights
    allowed = np.ones(places.shape, bool) if allowed is None else allowed
    nearest = np.floor(places + 0.5)
    sure = np.abs(places + 0.5 - np.round(places + 0.5)) > NEAR_A_TIE
    votes = np.zeros((2, rows, angles), np.int64)
    for t in range(angles):
        for kept, into in ((sure & allowed, (0, 1)), (~sure & allowed, (1,))):
            i = np.flatnonzero(kept[:, t])
            for side in (-NEAR_A_TIE, NEAR_A_TIE) if into == (1,) else (0,):
                r = np.floor(places[i, t] + 0.5 + side) if side else nearest[i, t]
                inside = (r >= 0) & (r < rows)
                for which in into:
                    np.add.at(votes[which, :, t], r[inside].astype(int), weights[i][inside])
    return votes


def vote(points, tables, windows, codes, weights, rows, angles):
    """Return votes in the integers that kernels add, (rows, angles)."""
    votes = np.zeros((rows, angles), np.int32)
    for i, (y, x) in enumerate(np.asarray(points, np.int64)):
        allowed = range(angles)
        if windows is not None:
            first, number = (table[codes[i]] for table in windows)
            allowed = [(first + k) % angles for k in range(number)]
        for t in allowed:
            rho = x * int(tables.cosine[t]) + y * int(tables.sine[t]) + int(tables.offset[t])
            votes[rho >> tables.shift, t] += weights[i]
    return votes


def half_turn_codes(angles):
    """Return the direction codes of angles modulo half a turn."""
    turned = np.asarray(angles, np.float32) * np.float32(DIRECTION_FACTOR) + np.float32(0.5)
    return np.floor(turned).astype(int) % (DIRECTIONS // 2)


def local_maxima(values, threshold, min_distance, min_angle, wraps):
    """Mark what is above the threshold and the first largest in its window."""
    rows, columns = values.shape
    mask = np.zeros(values.shape, np.uint8)
    for row, column in np.argwhere(values > threshold):
        window = []
        for t in range(column - min_angle, column + min_angle + 1):
            middle = row
            if not 0 <= t < columns:
                if not wraps:
                    continue
                t, middle = t % columns, rows - 1 - row
            for r in range(max(middle - min_distance, 0), min(middle + min_distance + 1, rows)):
                window.append((-values[r, t], r, t))
        mask[row, column] = min(window)[1:] == (row, column)
    return mask


def claim(points, codes, after, cosine, sine, rho, directions, distance, tolerance):
    """Return the first line behind `after` that each point is on, in float32 as kernels have it."""
    half = DIRECTIONS // 2
    labels = np.full(len(points), len(cosine), np.int32)
    for k in reversed(range(len(cosine))):
        away = np.abs(points[:, 1] * cosine[k] + points[:, 0] * sine[k] - rho[k])
        turn = (codes - directions[k]) % half
        on = (away <= np.float32(distance)) & (np.minimum(turn, half - turn) <= tolerance)
        labels[on & (k > after)] = k
    return labels
