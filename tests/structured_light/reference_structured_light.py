"""Gray codes and phases in NumPy, each operation in float32 where bits are to be equal."""

import numpy as np

from tests.filters.reference_gradients import orientation

F32 = np.float32


def gray_codes(frames, size, margin):
    """Decode pairs of frames: -1 where a pair is too close, or the code is beyond `size`."""
    frames = frames.astype(F32)
    pattern, inverse = frames[0::2], frames[1::2]
    bits = np.cumsum(pattern > inverse, axis=0) % 2
    weights = 2 ** np.arange(len(bits) - 1, -1, -1)
    codes = np.tensordot(weights, bits, 1)
    clear = (np.abs(pattern - inverse) > F32(margin)).all(axis=0)
    return np.where(clear & (codes < size), codes, -1).astype(np.int32)


def phases(frames, frequencies, waves, size):
    """Return places, phases of the last frequency, and least modulations, in float32."""
    frames, waves = frames.astype(F32), waves.astype(F32)
    steps, turn = len(waves), F32(1 / (2 * np.pi))
    place = angle = np.zeros(frames.shape[1:], F32)
    least = np.full(place.shape, np.inf, F32)
    for j, f in enumerate(np.asarray(frequencies, F32)):
        s, c = np.zeros_like(place), np.zeros_like(place)
        for n in range(steps):
            s = s + frames[j * steps + n] * waves[n, 0]
            c = c + frames[j * steps + n] * waves[n, 1]
        angle = orientation(s, c)
        least = np.minimum(least, F32(2) * np.sqrt(c * c + s * s) / F32(steps))
        p = angle * turn
        near = np.floor(f * place - p + F32(0.5))
        k = np.where(p < 0, F32(1), F32(0)) if j == 0 else near
        place = (p + k) / f
    lowest = F32(frequencies[0])
    u = lowest * place
    return (u - np.floor(u)) / lowest * F32(size) - F32(0.5), angle, least
