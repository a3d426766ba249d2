"""Arbitrary shapes: votes against float64, poses against the truth of pictures made here."""

import json
import math
from typing import Any

import numpy as np
import pytest
import scipy.ndimage as ndi
import skimage.data

import cvkern
from cvkern.hough.generalized._poses import placed
from cvkern.images import luma, read_image
from tests.calls import blobs
from tests.hough.generalized import reference_generalized as reference
from tests.truth import truth

SIDE = 60  # pixels along a side of a template


def photograph(name="camera"):
    image = getattr(skimage.data, name)()
    return (luma(image) if image.ndim == 3 else image).astype(np.float32)


def put(scene, source, centre, size, position, rotation, scale, hidden=0.0):
    """Return `scene` with the square of `source` round `centre` in a pose; the right of it hidden.

    A pixel of the scene shows what the inverse of the pose takes it to, by a cubic spline.
    """
    y, x = np.mgrid[: scene.shape[0], : scene.shape[1]]
    y, x = y - position[0], x - position[1]
    v = (math.cos(rotation) * y - math.sin(rotation) * x) / scale
    u = (math.sin(rotation) * y + math.cos(rotation) * x) / scale
    shown = (np.abs(v) <= size / 2) & (np.abs(u) <= size / 2) & (u <= size * (0.5 - hidden))
    values = ndi.map_coordinates(source, [v[shown] + centre[0], u[shown] + centre[1]], order=3)
    result = scene.copy()
    result[shown] = values
    return result


def cut(source, centre, size):
    """Return the square round a pixel's corner, and that corner, its reference point."""
    half = size // 2
    row, column = centre
    return source[row - half : row + half, column - half : column + half], (row - 0.5, column - 0.5)


def assert_pose(found, i, position, rotation, scale, pixels, degrees, share):
    assert np.hypot(*(found.position[i] - position)) < pixels
    turned = (found.rotation[i] - rotation + math.pi) % (2 * math.pi) - math.pi
    assert abs(math.degrees(turned)) < degrees
    assert abs(found.scale[i] / scale - 1) < share


def same(first, second):
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


# --- the table -----------------------------------------------------------------------------------


def test_vectors_point_from_the_boundary_to_the_reference(backend):
    """Round a disc the gradient of its brightness points at the centre."""
    y, x = np.mgrid[:61, :61] - 30.0
    disc = 1 / (1 + np.exp(np.hypot(y, x) - 20))
    table = cvkern.r_table(disc)
    angles = np.arctan2(*table.vectors.T)
    off = (angles - table.orientation + np.pi) % (2 * np.pi) - np.pi
    # By symmetry every gradient points at the centre. Sampled taps, cut off at 4 sigma, are not
    # quite isotropic: 2e-4 was measured.
    assert np.abs(off).max() < 4e-4
    # An edge pixel is at most half a diagonal from the crest, which the blur moves inwards by
    # sigma^2 / (2 r): 0.71 + 0.03 pixels. 0.62 was measured.
    np.testing.assert_allclose(np.hypot(*table.vectors.T), 20, rtol=0, atol=0.74)
    assert (np.diff(table.orientation) >= 0).all()
    assert (table.reference == 30).all()
    assert table.shape == (61, 61)
    assert table.vectors.dtype == table.orientation.dtype == np.float32
    moved = cvkern.r_table(disc, reference=(10.5, 70))
    np.testing.assert_array_equal(moved.vectors, table.vectors + np.array([-19.5, 40], np.float32))


def test_a_mask_with_orientation_is_as_good_as_the_picture(backend):
    template, _ = cut(photograph(), (130, 250), SIDE)
    scene = photograph()[60:220, 150:340]
    options = {"rotations": 12, "scales": [0.9, 1.0], "threshold": 0.0, "num_peaks": 3}

    limits: dict[str, Any] = {"low_threshold": 20, "high_threshold": 50}

    def edges(image):
        mask = cvkern.canny(image, **limits, operator="gaussian", mode="reflect")
        return mask, cvkern.gradient(image).orientation

    mask, angle = edges(template)
    table = cvkern.r_table(template, **limits)
    same(cvkern.r_table(mask, orientation=angle), table)
    same(cvkern.r_table(mask.astype(float), orientation=angle.astype(float)), table)
    mask, angle = edges(scene)
    want = cvkern.generalized_hough(scene, table, **options, **limits)
    assert len(want.votes)
    same(cvkern.generalized_hough(mask, table, orientation=angle, **options), want)


# --- the votes -----------------------------------------------------------------------------------


@pytest.mark.parametrize("cell", [1, 2, 4, 16])
@pytest.mark.parametrize(
    ("rotations", "tolerance"), [([0.3], 0.02), ([0.0, 2.0, -3.0], 0.3), ([1.0], 0.0)]
)
def test_votes_are_those_of_float64(backend, cell, rotations, tolerance):
    rng = np.random.default_rng(1)
    shape = (50, 71)
    mask = rng.random(shape) < 0.05
    angle = rng.uniform(-np.pi, np.pi, shape).astype(np.float32)
    vectors = rng.uniform(-25, 25, (40, 2)).astype(np.float32)
    table = cvkern.RTable(
        vectors, rng.uniform(-np.pi, np.pi, 40).astype(np.float32), np.zeros(2), (50, 50)
    )
    scales = [0.71, 1.0, 1.33]
    votes = cvkern.generalized_hough_votes(
        mask, table, rotations=rotations, scales=scales, orientation=angle,
        orientation_tolerance=tolerance, cell=cell,
    )  # fmt: skip
    bounds = reference.votes(
        np.argwhere(mask), angle[mask], vectors, table.orientation, rotations, scales, tolerance,
        shape, cell,
    )  # fmt: skip
    assert votes.dtype == np.int32
    assert votes.shape == (len(rotations), 3, -(-50 // cell), -(-71 // cell))
    assert (votes >= bounds.certain).all()
    assert (votes <= bounds.possible).all()
    if tolerance > 0:
        assert bounds.certain.sum() > 20 * len(rotations)
        if tolerance > 0.1:  # most votes are beyond doubt
            assert bounds.certain.sum() > 0.7 * votes.sum()


def test_each_pair_votes_once(backend):
    """Far from the border, with every direction allowed, votes are points times entries."""
    rng = np.random.default_rng(2)
    mask = np.zeros((120, 130), bool)
    mask[40:80, 45:85] = rng.random((40, 40)) < 0.2
    angle = rng.uniform(-3, 3, mask.shape)
    table = cvkern.RTable(
        rng.uniform(-20, 20, (30, 2)), np.sort(rng.uniform(-3, 3, 30)), np.zeros(2), (9, 9)
    )
    votes = cvkern.generalized_hough_votes(
        mask, table, rotations=3, scales=[0.5, 1.2], orientation=angle, orientation_tolerance=9
    )
    # The window of directions ends one of 16384 short of the full turn.
    expected = mask.sum() * 30
    assert ((votes.sum((2, 3)) <= expected) & (votes.sum((2, 3)) >= 0.99 * expected)).all()


def test_few_entries_are_taken_evenly(backend):
    scene = blobs(80, 90)
    table = cvkern.r_table(scene[20:60, 20:60])
    count = len(table.vectors)
    few = table._replace(vectors=table.vectors[::4], orientation=table.orientation[::4])
    number = len(few.vectors)
    taken = np.arange(number) * count // number
    few = table._replace(vectors=table.vectors[taken], orientation=table.orientation[taken])
    got = cvkern.generalized_hough_votes(scene, table, max_entries=number)
    np.testing.assert_array_equal(got, cvkern.generalized_hough_votes(scene, few))
    assert got.sum() < cvkern.generalized_hough_votes(scene, table, max_entries=count).sum()


@pytest.mark.parametrize("shape", [(1, 1), (1, 90), (77, 1), (9, 600), (65, 64)])
@pytest.mark.parametrize("cell", [1, 4])
def test_peaks_are_the_largest_sums_of_four_cells(backend, shape, cell):
    rng = np.random.default_rng(3)
    mask = rng.random(shape) < 0.3
    mask[0, 0] = True
    angle = np.zeros(shape)
    vectors = rng.uniform(-0.2, 0.2, (20, 2)) * np.minimum(shape, 40)
    table = cvkern.RTable(vectors, np.zeros(20), np.zeros(2), (9, 9))
    options = {"rotations": [0.0, 0.01], "scales": [0.9, 1.1], "orientation": angle, "cell": cell}
    votes = cvkern.generalized_hough_votes(mask, table, **options)
    found = cvkern.generalized_hough(mask, table, threshold=0, **options)
    padded = np.pad(votes, ((0, 0), (0, 0), (0, 1), (0, 1)))
    sums = padded[..., 1:, 1:] + padded[..., :-1, :-1] + padded[..., 1:, :-1] + padded[..., :-1, 1:]
    assert found.votes.max() == sums.max()


# --- the poses -----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_any_pose_is_found(backend, seed):
    rng = np.random.default_rng(seed)
    source = photograph()
    template, centre = cut(source, (130, 250), SIDE)
    scale, rotation = rng.uniform(0.8, 1.6), rng.uniform(-np.pi, np.pi)
    position = rng.uniform([70, 70], [150, 190])
    scene = put(photograph("coins")[:220, :260], source, centre, SIDE, position, rotation, scale)
    scene += rng.normal(0, 4, scene.shape).astype(np.float32)
    scales = np.linspace(0.8, 1.6, 9)
    found = cvkern.detect_shape(template, scene, rotations=120, scales=scales)
    # Twice what was measured: a tenth of a cell and of a bin, which votes alone cannot tell.
    assert_pose(found, 0, position, rotation, scale, pixels=0.35, degrees=0.6, share=0.008)
    assert found.support[0] > 0.3  # the noise turns many a weak gradient by more than is allowed


def test_several_are_found_and_half_hidden_ones_too(backend):
    source = photograph()
    template, centre = cut(source, (130, 250), SIDE)
    poses = [((60, 60), 0.4, 1.0, 0.0), ((70, 190), -2.0, 1.3, 0.0), ((200, 80), 3.0, 0.9, 0.0),
             ((190, 210), 1.2, 1.2, 0.5)]  # fmt: skip
    scene = np.full((260, 280), 90, np.float32)
    scene += 20 * ndi.gaussian_filter(np.random.default_rng(0).normal(size=scene.shape), 2)
    for position, rotation, scale, hidden in poses:
        scene = put(scene, source, centre, SIDE, position, rotation, scale, hidden)
    table = cvkern.r_table(template)
    options = {"rotations": 120, "scales": np.linspace(0.8, 1.4, 7)}
    found = cvkern.generalized_hough(scene, table, **options)
    assert len(found.votes) == 4
    assert (np.diff(found.support) <= 0).all()
    assert found.support[3] < 0.35 < found.support[2]  # the hidden one
    for position, rotation, scale, _ in poses:
        i = int(np.argmin(np.hypot(*(found.position - position).T)))
        assert_pose(found, i, position, rotation, scale, pixels=0.22, degrees=0.62, share=0.006)
    some = cvkern.generalized_hough(scene, table, threshold=0.35, **options)
    # Other candidates are dropped early; those left end within a tenth of a pixel of one another.
    np.testing.assert_allclose(some.position, found.position[:3], atol=0.1)
    assert len(cvkern.generalized_hough(scene, table, num_peaks=2, **options).votes) == 2


def test_the_template_in_a_photograph(backend):
    folder = truth("hough/generalized")
    known = json.loads((folder / "location.json").read_text())
    template, scene = (read_image(folder / f"{n}.png") for n in ("template", "scene"))
    template, scene = (luma(a) if a.ndim == 3 else a for a in (template, scene))
    (left, top), (width, height) = known["top_left_xy"], known["size_wh"]
    centre = top + (height - 1) / 2, left + (width - 1) / 2
    found = cvkern.detect_shape(template, scene)
    pose = centre, math.radians(known["rotation_deg"]), known["scale"]
    assert_pose(found, 0, *pose, pixels=0.1, degrees=0.1, share=0.002)


def test_what_a_shape_does_not_tell_apart_is_one_unless_asked(backend):
    """A square looks the same four times a turn."""
    scene = np.full((120, 130), 20.0)
    scene[30:71, 40:81] = 200
    table = cvkern.r_table(scene[20:81, 30:91], sigma=1.5)
    options = {"rotations": 72, "sigma": 1.5, "threshold": 0.7}
    (rotation,) = cvkern.generalized_hough(scene, table, **options).rotation
    quarters = rotation / (math.pi / 2)
    assert abs(quarters - round(quarters)) < 0.02
    four = cvkern.generalized_hough(scene, table, min_rotation=0.7, **options)
    turns = np.sort(np.mod(np.degrees(four.rotation) + 45, 360))
    # Twice what was measured, 0.107 degrees.
    np.testing.assert_allclose(turns, [45, 135, 225, 315], rtol=0, atol=0.214)
    # Edge pixels of the table and of the scene are each up to half a pixel off; 0.79 was measured.
    np.testing.assert_allclose(four.position, np.full((4, 2), [50, 60]), rtol=0, atol=1)


def test_two_scales_at_one_place(backend):
    y, x = np.mgrid[:140, :150]
    size = np.maximum(np.abs(y - 70), np.abs(x - 75) * 1.7)
    scene = np.where(size < 25, 200.0, np.where(size < 50, 120.0, 30.0))
    table = cvkern.r_table(np.where(size < 25, 200.0, 30.0)[35:106, 40:111], sigma=1.5)
    options = {"scales": np.linspace(0.8, 2.2, 15), "sigma": 1.5, "threshold": 0.6}
    options["min_distance"] = 30.0
    assert len(cvkern.generalized_hough(scene, table, **options).scale) == 1
    both = cvkern.generalized_hough(scene, table, min_ratio=1.5, **options)
    np.testing.assert_allclose(np.sort(both.scale), [1, 2], rtol=0.04)  # half a pixel in 14


def test_memory_does_not_change_what_is_found(backend):
    source = photograph()
    template, centre = cut(source, (130, 250), SIDE)
    scene = put(photograph("coins")[:150, :180], source, centre, SIDE, (70, 90), 0.5, 1.1)
    table = cvkern.r_table(template)
    options = {"rotations": 24, "scales": [0.9, 1.0, 1.1], "threshold": 0.0, "num_peaks": 5}
    want = cvkern.generalized_hough(scene, table, **options)
    each = 4 * (38 * 45 + 5 * 6)
    for slices in (1, 2, 3, 7, 25):
        same(cvkern.generalized_hough(scene, table, max_bytes=slices * each, **options), want)


@pytest.mark.parametrize("threads", ["1", "2", "3", "7"])
def test_any_number_of_threads_gives_the_same(threads, monkeypatch):
    scene = photograph()[:200, :240]
    table = cvkern.r_table(scene[100:160, 100:160])
    options = {"rotations": 30, "scales": [0.9, 1.0, 1.1]}
    want = cvkern.generalized_hough_votes(scene, table, **options)
    monkeypatch.setenv("CVKERN_NUM_THREADS", threads)
    np.testing.assert_array_equal(cvkern.generalized_hough_votes(scene, table, **options), want)


def test_an_image_without_edges_has_no_shapes(backend):
    table = cvkern.r_table(blobs(40, 40))
    for found in (
        cvkern.generalized_hough(np.zeros((50, 60)), table, rotations=3, threshold=0),
        cvkern.generalized_hough(np.zeros((5, 6)), table, orientation=np.full((5, 6), np.nan)),
        cvkern.detect_shape(blobs(40, 40), np.full((1, 1), 3.0)),
    ):
        assert [a.shape for a in found] == [(0, 2), (0,), (0,), (0,), (0,)]
        assert [a.dtype for a in found] == ["f4", "f4", "f4", "i4", "f4"]
    assert not cvkern.generalized_hough_votes(np.zeros((50, 60)), table).any()
    unlike = cvkern.generalized_hough(blobs(50, 60, seed=1), table, threshold=1.0)
    assert unlike.position.shape == (0, 2)


def test_results_are_the_callers_arrays(backend):
    torch = pytest.importorskip("torch")
    image = photograph()[:120, :140]
    found = cvkern.detect_shape(image[30:90, 30:90], torch.from_numpy(image), rotations=4)
    assert all(isinstance(a, torch.Tensor) for a in found)
    same(found, cvkern.detect_shape(image[30:90, 30:90], image, rotations=4))


def test_templates_without_a_boundary_are_refused(backend):
    for template in (np.full((30, 30), 7.0), np.ones((1, 1))):
        with pytest.raises(ValueError, match=r"^template must have boundary points, got none$"):
            cvkern.r_table(template)
    with pytest.raises(ValueError, match=r"within 4096 pixels of the reference, got 4998\.05"):
        cvkern.r_table(blobs(30, 30), reference=(5000, 0))


def test_orientation_counts_where_the_mask_is_set_alone(backend):
    mask, angle = np.zeros((6, 7), bool), np.full((6, 7), np.nan)
    mask[2, 3] = True
    for wrong, said in ((np.nan, "nan"), (np.inf, "inf"), (-9, "-9")):
        angle[2, 3] = wrong
        message = rf"^orientation must be in \[-7, 7\] where the mask is set, got {said}$"
        with pytest.raises(ValueError, match=message):
            cvkern.r_table(mask, orientation=angle)
    angle[2, 3] = 1
    np.testing.assert_allclose(cvkern.r_table(mask, orientation=angle).orientation, 1, atol=2e-4)


def test_what_the_host_decides_is_refused_by_capture(backend):
    image = blobs(40, 50)
    with pytest.raises(ValueError, match=r"^captured functions must be kernels alone, got "):
        cvkern.capture(cvkern.detect_shape, image[5:30, 5:30], image)


def test_outlines_lie_where_the_shape_was_put():
    """A quarter turn takes what is to the right to below."""
    got = placed(np.array([[0.0, 3.0], [1.0, 0.0]]), np.array([10.0, 20.0]), math.pi / 2, 2.0)
    np.testing.assert_allclose(got, [[16, 20], [10, 18]], atol=1e-12)
