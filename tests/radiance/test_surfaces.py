"""Points and surfaces of a field with known rays, and bad input to what looks at fields."""

import json
import struct
import sys

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cvkern.radiance import (
    Mesh,
    mesh,
    orbit_cameras,
    point_cloud,
    render,
    surfaces,
    write_mesh,
)
from tests.radiance.test_rendering import (
    BOUNDS,
    COLOR,
    RADIUS,
    Ball,
    ball,
    some_cameras,
)


def test_point_cloud(backend):
    cloud = point_cloud(ball())
    away = np.linalg.norm(cloud.points - BOUNDS.center, axis=1)
    np.testing.assert_allclose(
        away, RADIUS * BOUNDS.half, atol=1e-4
    )  # float32, at distances of about 6
    assert (cloud.colors == np.round(255 * COLOR)).all()
    assert (cloud.points.dtype, cloud.colors.dtype) == (np.float32, np.uint8)
    seen = [np.isfinite(render(ball(), some_cameras(), v).depth).sum() for v in range(5)]
    assert len(cloud.points) == sum(seen)
    assert len(point_cloud(ball(), views=[1]).points) == seen[1]
    assert len(point_cloud(ball(), views=[]).points) == 0


def test_mesh():
    surface = mesh(ball(), resolution=32, density=50.0, smooth=0)
    away = np.linalg.norm(surface.points - BOUNDS.center, axis=1)
    # The density is 50 on the ball, and linear along the radius; chords of cells of 1/16 are off
    # by less than (1/16)^2 / (8 * 0.5), twice that in the world.
    np.testing.assert_allclose(away, RADIUS * BOUNDS.half, atol=2 / 16**2 / 4)
    corners = surface.points[surface.faces] - BOUNDS.center
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((normals * corners.mean(axis=1)).sum(axis=1) > 0).all()  # anticlockwise from outside
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * (RADIUS * BOUNDS.half) ** 3, rel=0.02)
    assert (surface.colors == np.round(255 * COLOR)).all()
    assert surface.faces.dtype == np.int32


def pieces_of(surface):
    edges = np.concatenate((surface.faces[:, :2], surface.faces[:, 1:]))
    links = coo_array((np.ones(len(edges), bool), edges.T), shape=(len(surface.points),) * 2)
    return connected_components(links, directed=False)[0]


def test_pieces_that_no_camera_sees_are_left_out(monkeypatch):
    """A ball with hollows of noise within, whose cameras see its outside alone."""
    plain = Ball.densities
    noise = np.random.default_rng(0)

    def densities(self, points):
        deep = np.linalg.norm(points, axis=1) < 0.6 * RADIUS
        return np.where(deep, 30 * noise.lognormal(size=len(points)), plain(self, points))

    monkeypatch.setattr(Ball, "densities", densities)
    rough = mesh(ball(), resolution=32, density=50.0, smooth=0, pieces=None)
    assert pieces_of(rough) == 1
    monkeypatch.setattr(surfaces, "SEEN", 0)
    assert pieces_of(mesh(ball(), resolution=32, density=50.0, smooth=0, pieces=None)) >= 3


def test_smoothed_mesh(monkeypatch):
    """Noise outside makes no pieces, and the surface stays where it was."""
    plain = Ball.densities
    noise = np.random.default_rng(0)

    def densities(self, points):
        return plain(self, points) + 20 * noise.lognormal(sigma=0.7, size=len(points))

    monkeypatch.setattr(Ball, "densities", densities)
    monkeypatch.setattr(surfaces, "SEEN", 0)  # all pieces count
    assert pieces_of(mesh(ball(), resolution=32, density=75.0, smooth=0, pieces=None)) > 100
    surface = mesh(ball(), resolution=32, density=75.0, pieces=None)
    assert pieces_of(surface) == 1
    # The noise adds 25.6 to the density, which falls by 200 per unit of the frame; smoothing with
    # a cell of 1/16 moves a sphere of radius r inwards by (1/16)^2 / r.
    away = np.linalg.norm(surface.points - BOUNDS.center, axis=1) / BOUNDS.half
    assert away.mean() == pytest.approx(RADIUS + 0.5 * 0.006 - (1 / 16) ** 2 / RADIUS, abs=0.005)


def test_colors_of_a_rough_mesh_are_seen_across_it(monkeypatch):
    """Looked at from without, a ball of noise has the colour of its directions."""
    noise, plain = np.random.default_rng(0), Ball.see

    def see(self, origins, directions, seen, row=0):
        plain(self, origins, directions, seen)
        towards = self.rt.to_numpy(directions)
        self.rt.write(seen.color, np.ascontiguousarray(0.5 - 0.5 * towards))
        self.rt.write(seen.opacity, np.ones(len(towards), np.float32))

    def densities(self, points):
        inside = np.linalg.norm(points, axis=1) < RADIUS
        return np.where(inside, 100 * noise.lognormal(size=len(points)), 0)

    monkeypatch.setattr(Ball, "see", see)
    monkeypatch.setattr(Ball, "densities", densities)
    surface = mesh(ball(), resolution=40, density=25.0, smooth=0)
    arms = surface.points - BOUNDS.center
    away = np.linalg.norm(arms, axis=1, keepdims=True)
    outer = away[:, 0] > (RADIUS - 2 / 40) * BOUNDS.half  # within there are pits
    want = 255 * (0.5 + 0.5 * arms / away)
    assert outer.sum() > 1000
    # Two degrees off, a channel is up to 128 x 0.035 off. Across the rough surface it would be 40.
    assert np.abs(surface.colors - want)[outer].mean() < 4.5


def test_meshes_as_files(tmp_path):
    surface = mesh(ball(), resolution=8, density=50.0)
    write_mesh(tmp_path / "ball.ply", surface)
    head, _, body = (tmp_path / "ball.ply").read_bytes().partition(b"end_header\n")
    lines = head.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert f"element vertex {len(surface.points)}" in lines
    assert f"element face {len(surface.faces)}" in lines
    kind = [("place", "<f4", 3), ("color", "u1", 3)]
    points = np.frombuffer(body, kind, len(surface.points))
    np.testing.assert_array_equal(points["place"], surface.points)
    np.testing.assert_array_equal(points["color"], surface.colors)
    faces = np.frombuffer(body[points.nbytes :], [("count", "u1"), ("corners", "<i4", 3)])
    assert (faces["count"] == 3).all()
    np.testing.assert_array_equal(faces["corners"], surface.faces)
    with pytest.raises(ValueError, match=r"path must end in .ply or .glb, got 'ball.obj'"):
        write_mesh("ball.obj", surface)


def test_mesh_without_scikit_image(monkeypatch):
    monkeypatch.setitem(sys.modules, "skimage.measure", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'cvkern\[demo\]'"):
        mesh(ball())


@pytest.mark.parametrize(
    ("call", "error", "rule"),
    [
        (lambda m: render(m, m.cameras, 5), ValueError, r"view must be in \[0, 4\], got 5"),
        (lambda m: render(m, m.cameras, m.seed + 0.5), TypeError,
         "view must be an integer, got 0.5"),
        (lambda m: render(m, m.cameras, background=(0, 2, 0)), ValueError,
         r"background must be three numbers in \[0, 1\], got \(0, 2, 0\)"),
        (lambda m: render(m, m.cameras, background="white"), TypeError,
         "background must be real numbers, got 'white'"),
        (lambda m: point_cloud(m, views=[7]), ValueError, r"views must be in \[0, 4\], got 7"),
        (lambda m: mesh(m, resolution=4), ValueError, r"resolution must be in \[8, 1024\], got 4"),
        (lambda m: mesh(m, density=-1), ValueError, "density must be > 0, got -1"),
        (lambda m: mesh(m, resolution=8, density=1e6), ValueError,
         "density must be below the model's largest, 100, got 1e"),
        (lambda m: orbit_cameras(m.cameras, 0), ValueError, "frames must be in"),
        (lambda m: orbit_cameras(m.cameras, factor=0), ValueError, "factor must be > 0, got 0"),
        (lambda m: m.save("model.txt"), ValueError, "path must end in .npz, got 'model.txt'"),
    ],
)  # fmt: skip
def test_errors(call, error, rule):
    with pytest.raises(error, match=rule):
        call(ball())


def test_gltf(tmp_path):
    """The file is read as the specification of glTF 2.0 says, by nothing of ours."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3]], np.int32)
    colors = np.array([[0, 0, 0], [255, 255, 255], [188, 10, 255], [1, 2, 3]], np.uint8)
    write_mesh(tmp_path / "mesh.glb", Mesh(points, faces, colors))
    data = (tmp_path / "mesh.glb").read_bytes()
    magic, version, size, length, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, size, kind, length % 4) == (b"glTF", 2, len(data), b"JSON", 0)
    content = json.loads(data[20 : 20 + length])
    count, kind = struct.unpack_from("<I4s", data, 20 + length)
    body = data[28 + length :]
    assert (kind, count) == (b"BIN\0", len(body))
    assert content["buffers"] == [{"byteLength": count}]
    assert content["asset"]["version"] == "2.0"
    types = {5126: "<f4", 5123: "<u2", 5125: "<u4"}
    columns = {"VEC3": 3, "VEC4": 4, "SCALAR": 1}

    def values(number):
        accessor = content["accessors"][number]
        view = content["bufferViews"][accessor["bufferView"]]
        begin = view["byteOffset"]
        found = np.frombuffer(
            body[begin : begin + view["byteLength"]], types[accessor["componentType"]]
        ).reshape(-1, columns[accessor["type"]])
        assert len(found) == accessor["count"]
        assert begin % 4 == 0
        if "min" in accessor:
            assert (accessor["min"], accessor["max"]) == ([0, 0, 0], [1, 2, 3])
        return found

    (shape,) = content["meshes"][content["nodes"][0]["mesh"]]["primitives"]
    np.testing.assert_array_equal(values(shape["attributes"]["POSITION"]), points)
    np.testing.assert_array_equal(values(shape["indices"]).reshape(-1, 3), faces)
    tints = values(shape["attributes"]["COLOR_0"]) / 65535
    assert content["accessors"][shape["attributes"]["COLOR_0"]]["normalized"]
    assert (tints[:, 3] == 1).all()
    np.testing.assert_array_equal(tints[:2, :3], [[0] * 3, [1] * 3])
    # Half of the light has the code 188 of sRGB.
    np.testing.assert_allclose(tints[2, :3], [0.5029, 0.003035, 1], atol=1e-4)
    upright = np.array(content["nodes"][0]["matrix"]).reshape(4, 4).T  # by columns
    np.testing.assert_array_equal(upright @ [0, 0, 1, 1], [0, 1, 0, 1])
    assert np.linalg.det(upright) == 1
    with pytest.raises(ValueError, match="faces must have a triangle"):
        write_mesh(tmp_path / "none.glb", Mesh(points, faces[:0], colors))
