"""Full disks: old files stay, and no other files are left behind."""

import contextlib

import numpy as np
import pytest

from cvkern.clouds import write_animation, write_ply
from cvkern.radiance import Mesh, VoxelField, fit, load_model, make_scene, write_mesh

resource = pytest.importorskip("resource")  # where files can be held to a size
ROOM = 4096  # bytes that the disk still takes
SMALL = VoxelField(resolutions=(16,), shares=(), rays=64)


@contextlib.contextmanager
def full_disk():
    """Let writes to files fail from a size on, as a disk does that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


NOISE = np.random.default_rng(0)
POINTS, COLORS = NOISE.random((900, 3), np.float32), NOISE.integers(0, 256, (900, 3), np.uint8)
FACES = np.arange(900, dtype=np.int32).reshape(-1, 3)
FRAMES = NOISE.integers(0, 256, (3, 40, 40, 3), np.uint8)
WRITERS = {
    "points.ply": lambda file: write_ply(file, POINTS, COLORS),
    "mesh.ply": lambda file: write_mesh(file, Mesh(POINTS, FACES, COLORS)),
    "film.gif": lambda file: write_animation(file, FRAMES),
}


@pytest.mark.parametrize("name", WRITERS)
def test_files(tmp_path, name):
    file = tmp_path / name
    WRITERS[name](file)
    before = file.read_bytes()
    assert len(before) > ROOM
    with full_disk(), pytest.raises(OSError, match="File too large"):
        WRITERS[name](file)
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_checkpoints(tmp_path):
    file, scene = tmp_path / "model.npz", make_scene(train=4, test=1, size=12)
    model = fit(scene, SMALL, steps=2, checkpoint=file, progress=False)
    before = file.read_bytes()
    with full_disk(), pytest.raises(OSError, match="File too large"):
        model.save(file)
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]
    assert load_model(file).training.step == 2
