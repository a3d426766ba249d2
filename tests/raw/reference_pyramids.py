"""Pyramids, local Laplacian filters and fusion in NumPy, float64."""

from itertools import pairwise

import numpy as np

TAPS = np.array([1, 4, 6, 4, 1]) / 16


def reduced(image):
    """Smooth by the taps, mirrored at the border, and keep every second row and column."""
    for axis in (0, 1):
        n = image.shape[axis]
        width = [(2, 2) if a == axis else (0, 0) for a in range(image.ndim)]
        framed = np.moveaxis(np.pad(image, width, mode="reflect" if n > 1 else "edge"), axis, 0)
        parts = [t * framed[k : k + n : 2] for k, t in enumerate(TAPS)]
        image = np.moveaxis(np.sum(parts, axis=0), 0, axis)
    return image


def expanded(image, shape):
    """Put values on every second row and column of zeros, and smooth by twice the taps."""
    for axis in (0, 1):
        x, n = np.moveaxis(image, axis, 0), shape[axis]
        at = np.arange(n)[:, None] + np.arange(-2, 3)
        even = at % 2 == 0
        place = np.abs(at)
        place = np.where(place > n - 1, 2 * (n - 1) - place, place) // 2
        place = place.clip(0, len(x) - 1)
        weights = np.where(even, 2 * TAPS, 0)
        image = np.moveaxis(np.einsum("nk,nk...->n...", weights, x[place]), 0, axis)
    return image


def gaussians(image, levels):
    found = [image]
    for _ in range(levels - 1):
        found.append(reduced(found[-1]))
    return found


def laplacians(image, levels):
    found = gaussians(image, levels)
    return [a - expanded(b, a.shape) for a, b in pairwise(found)] + found[-1:]


def remapped(image, about, sigma, slope):
    near = (image - about).clip(-sigma, sigma)
    return about + near + slope * (image - about - near)


def collapsed(bands):
    image = bands[-1]
    for band in bands[-2::-1]:
        image = band + expanded(image, band.shape)
    return image


def local_laplacian(image, levels, sigma, slope):
    """Follow Paris, Hasinoff and Kautz 2011: an own pyramid for each coefficient."""
    base = gaussians(image, levels)
    bands = [np.zeros(b.shape) for b in base]
    for level in range(levels - 1):
        for place in np.ndindex(bands[level].shape):
            own = remapped(image, base[level][place], sigma, slope)
            bands[level][place] = laplacians(own, levels)[level][place]
    bands[-1] = slope * base[-1]
    return collapsed(bands)


def fast_local_laplacian(image, levels, sigma, slope, count):
    """Follow Aubry et al. 2014: pyramids for some references, and between these a straight line."""
    base = gaussians(image, levels)
    lowest, step = image.min(), np.ptp(image) / (count - 1)
    bands = [np.zeros(b.shape) for b in base]
    for k in range(count):
        about = lowest + k * step
        own = laplacians(remapped(image, about, sigma, slope), levels)
        for level in range(levels - 1):
            near = np.maximum(1 - np.abs((base[level] - lowest) / step - k), 0)
            bands[level] += near * own[level]
    bands[-1] = slope * base[-1]
    return collapsed(bands)


def fused(images, contrast, saturation, exposure):
    """Follow Mertens, Kautz and Van Reeth 2007, for (K, H, W, C) in 0 to 1."""
    weights = []
    for image in images:
        grey = image.mean(axis=2)
        framed = np.pad(grey, 1, mode="reflect" if min(grey.shape) > 1 else "edge")
        sides = framed[:-2, 1:-1] + framed[2:, 1:-1] + framed[1:-1, :-2] + framed[1:-1, 2:]
        quality = np.abs(sides - 4 * grey) ** contrast
        if image.shape[2] == 3:
            quality *= image.std(axis=2) ** saturation
        well = np.exp(-((image - 0.5) ** 2) / (2 * 0.2**2)).prod(axis=2)
        weights.append(quality * well**exposure + 1e-12)
    weights = np.array(weights) / np.sum(weights, axis=0)
    levels = 1 + int(np.log2(min(images.shape[1:3])))
    bands = [0.0] * levels
    for image, weight in zip(images, weights, strict=True):
        parts = zip(laplacians(image, levels), gaussians(weight, levels), strict=True)
        bands = [b + d * w[..., None] for b, (d, w) in zip(bands, parts, strict=True)]
    f, knee = collapsed(bands), 0.05
    f = np.where(f < knee, knee * np.exp(np.minimum(f / knee - 1, 0)), f)
    over = np.maximum((f - 1) / knee + 1, 0)
    return np.where(over > 0, 1 - knee * np.exp(-over), f)
