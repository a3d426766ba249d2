"""What the kernels of recognition compute, in NumPy and plain Python."""

import numpy as np

WHITE, SPREAD, LARGEST = 4095, 32, 127


def rounded(image):
    return np.floor(np.clip(image, 0, 1) * np.float32(WHITE) + np.float32(0.5)).astype(int)


def normalised(image, corners, side, least):
    """Patches of mean 0 and standard deviation 32, by exact integers of Python."""
    pixels = rounded(image)
    found = []
    for row, column in corners:
        patch = pixels[row : row + side, column : column + side].ravel().astype(object)
        n, total = len(patch), sum(patch)
        square = n * sum(patch * patch) - total * total
        root = int(np.floor(np.sqrt(float(square))))  # below 2^53: exact
        if root < least:
            found.append(np.zeros(n, int))
        else:
            value = [(2 * SPREAD * (n * x - total) + root) // (2 * root) for x in patch]
            found.append(np.clip(np.array(value, float), -LARGEST, LARGEST))
    return np.array(found).astype(np.int8)


def best_words(patches, words, least, most):
    """All products at once, then a stable sort."""
    products = patches.astype(np.int64) @ words.astype(np.int64).T
    order = np.argsort(-products, axis=1, kind="stable")[:, :most]
    best = np.take_along_axis(products, order, axis=1)
    kept = best >= least
    missing = ((0, 0), (0, most - order.shape[1]))
    return (
        np.pad(np.where(kept, best, 0), missing),
        np.pad(np.where(kept, order, -1), missing, constant_values=-1),
    )


def factor(scale):
    return int(np.rint(2**16 * 2 ** (scale / 64)))


def votes(places, matches, starts, entries, bins, slack):
    """Every vote: cell, row, column, scale, weight, patch, occurrence."""
    found = []
    for i, (y, x, z) in enumerate(places.tolist()):
        words = [w for w in matches[i].tolist() if w >= 0]
        for word in words:
            for e in range(starts[word], starts[word + 1]):
                dy, dx, dz, weight = entries[e].tolist()
                row, column = (
                    p + int(np.floor(d * factor(z) / 2**16 + 0.5)) for p, d in ((y, dy), (x, dx))
                )
                apart = np.abs(z + dz - bins[:, 3])
                s = int(apart.argmin())
                first, rows, columns, _, side = bins[s].tolist()
                if apart[s] > slack or row < 0 or column < 0:
                    continue
                r, c = row // side, column // side
                if r < rows and c < columns:
                    cell = first + r * columns + c
                    found.append((cell, row, column, z + dz, weight // len(words), i, e))
    return np.array(found, np.int64).reshape(-1, 7)


def maxima(sums, bins, tiles):
    """The best cell of each tile by the sum of 3 x 3."""
    found = []
    for s, top, left, bottom, right in tiles.tolist():
        first, rows, columns, z, side = bins[s].tolist()
        plane = np.pad(sums[first : first + rows * columns].reshape(rows, columns), 1)
        around = np.lib.stride_tricks.sliding_window_view(plane.astype(np.int64), (3, 3))
        value = around.sum(axis=(2, 3))[top:bottom, left:right]
        if value.max() == 0:
            found.append((-1, -1, -1, -1))
            continue
        r, c = np.unravel_index(value.argmax(), value.shape)
        middle = [(n * side) + side // 2 for n in (top + r, left + c)]
        found.append((*middle, z, value.max() // 9))
    return np.array(found)


def mode(votes, place, radius, scales, rounds):
    """Mean shift over all votes, without cells; the density is of the last place."""
    y, x, z = (int(n) for n in place)
    rows, density = votes[:, 1:5], 0
    for left in range(rounds, -1, -1):
        reach = int(np.floor(radius * factor(z) / 2**16 + 0.5))
        dy, dx, dz = rows[:, 0] - y, rows[:, 1] - x, rows[:, 2] - z
        height = 1024 - 1024 * (dy**2 + dx**2) // reach**2 - 1024 * dz**2 // scales**2
        weight = np.where(height > 0, rows[:, 3], 0)
        density, mass = int((weight * height).sum()) // 1024, int(weight.sum())
        if not left or not mass:
            break
        mean = [int((2 * (weight * rows[:, k]).sum() + mass) // (2 * mass)) for k in range(3)]
        if mean == [y, x, z]:
            break
        y, x, z = mean
    return y, x, z, density


def evidence(places, matches, levels, weights, frame, at, inside=None):
    """The evidence at a place, of the patches that are in the box of another place too."""
    layers, *box = frame
    total = 0
    for half_height, half_width, down, along, offset, first in layers.tolist():
        scale = int(levels[np.abs(levels - at[2] - offset).argmin()])
        for (y, x, z), words in zip(places.tolist(), matches.tolist(), strict=True):
            if z != scale:
                continue
            row = (y - int(at[0])) * 2**16 // factor(scale) + half_height
            column = (x - int(at[1])) * 2**16 // factor(scale) + half_width
            if not (0 <= row < 2 * half_height and 0 <= column < 2 * half_width):
                continue
            if inside is not None:
                high, wide = (int(np.floor(n * factor(inside[2]) / 2**16 + 0.5)) for n in box)
                if abs(y - inside[0]) > high or abs(x - inside[1]) > wide:
                    continue
            cell = row * down // (2 * half_height) * along + column * along // (2 * half_width)
            total += sum(int(weights[w, first + cell]) for w in words if w >= 0)
    return total


def shortest(evidence, shared, least):
    """Every step of the greedy description anew; `shared` gives the evidence that two share."""
    chosen = []
    while True:
        left = {
            i: evidence[i] - sum(max(shared(i, j), 0) for j in chosen)
            for i in range(len(evidence))
            if i not in chosen
        }
        best = max(left, key=lambda i: (left[i], -i), default=None)
        if best is None or left[best] < least:
            return chosen
        chosen.append(best)


def balance(votes, places, figures, at, window, frame, shape):
    """What the votes in the kernel of a place, of patches in the box, say of each pixel."""
    side = int(np.sqrt(figures.shape[1]))
    reach = int(np.floor(window.radius * factor(at[2]) / 2**16 + 0.5))
    found = np.zeros(shape, int)
    for _, y, x, z, weight, patch, entry in votes.tolist():
        apart = (y - at[0]) ** 2 + (x - at[1]) ** 2
        near = 1024 - 1024 * apart // reach**2 - 1024 * (z - at[2]) ** 2 // window.scales**2
        row, column, size = places[patch].tolist()
        if near <= 0 or abs(size - at[2]) >= 32:
            continue
        half = (int(np.floor(n * factor(size) / 2**16 + 0.5)) for n in frame[1:])
        if any(abs(p - q) > h + reach for p, q, h in zip((row, column), at, half, strict=False)):
            continue
        first = [
            ((int(places[patch, i]) - at[i]) * 2**16 // factor(at[2]) + 8 * (shape[i] - side) + 8)
            // 16
            for i in (0, 1)
        ]
        for k, share in enumerate(figures[entry].tolist()):
            row, column = first[0] + k // side, first[1] + k % side
            if 0 <= row < shape[0] and 0 <= column < shape[1]:
                found[row, column] += (weight * near // 1024) * (2 * share - 255) // 256
    return found


def mask(box, at, shape):
    """Where the balance of a box, linear between its pixels, is above 0."""
    padded = np.pad(box, 1)
    found = np.zeros(shape, bool)
    for row in range(shape[0]):
        for column in range(shape[1]):
            y, x = (
                (16 * n - at[i]) * 2**16 // factor(at[2]) + 8 * (box.shape[i] - 1)
                for i, n in enumerate((row, column))
            )
            top, left = y // 16, x // 16
            if not (-1 <= top < box.shape[0] and -1 <= left < box.shape[1]):
                continue
            (a, b), (c, d) = padded[top + 1 : top + 3, left + 1 : left + 3]
            upper, lower = ((16 - x % 16) * p + x % 16 * q for p, q in ((a, b), (c, d)))
            found[row, column] = (16 - y % 16) * upper + y % 16 * lower > 0
    return found
