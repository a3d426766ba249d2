"""The tour's experiment with noisy lines shows the effects that it describes."""

import numpy as np

from cvkern.app.tour import line_noise


def test_noise_lowers_peaks_and_directions_lead():
    found = line_noise.by_noise(4)
    for way in line_noise.WAYS:
        heights = found[way]["height"]
        assert heights[0] > heights[-1]
    plain, smoothed, directed = (np.array(found[way]["lead"]) for way in line_noise.WAYS)
    assert (directed > 1.5 * plain).all()
    assert (directed > 1.2 * smoothed).all()
    assert plain[0] > smoothed[0]
    assert smoothed[-1] > plain[-1]


def test_bins_may_be_too_narrow_and_too_wide():
    plain = dict(zip(line_noise.BINS, line_noise.by_bins(4)["plain"], strict=True))
    assert plain[1.0] < plain[0.25]
    assert plain[1.0] < plain[5.0]


def test_points_are_where_they_are_said_to_be():
    scene = line_noise.scatter(np.random.default_rng(3), 0.0)
    y, x = scene.points[: line_noise.POINTS].T.astype(float)
    rho = x * np.cos(scene.theta) + y * np.sin(scene.theta)
    inside = (np.minimum(x, y) > 0) & (np.maximum(x, y) < line_noise.SIDE - 1)
    assert inside.mean() > 0.8
    np.testing.assert_allclose(rho[inside], scene.rho, atol=1e-4)  # float32 of up to 256
