"""Targets that are files behind memory maps, and the tiles of arrays in chunks."""

import os
from typing import NamedTuple

import numpy as np
import pytest

import cvkern
from cvkern._archives import map_array
from cvkern.scale import apply, grids, targets


def noise():
    return np.random.default_rng(0).integers(0, 256, (61, 97), np.uint8)


@pytest.mark.parametrize("tile", [None, (20, 97), (20, 30), (61, 40)])
def test_rows_are_written_past_the_map(tmp_path, monkeypatch, tile):
    """Some calls of the system write less than they are asked for."""
    image, calls = np.dstack((noise(),) * 3), []
    whole = os.pwritev

    def short(file, pieces, at):
        calls.append(len(pieces))
        part = pieces[:2] if len(calls) % 2 else [pieces[0][: len(pieces[0]) // 2 + 1]]
        return whole(file, part, at)

    monkeypatch.setattr(os, "pwritev", short)
    target = np.lib.format.open_memmap(tmp_path / "out.npy", "w+", np.float32, image.shape)
    apply("gaussian", image, target, tile=tile, sigma=2, channel_axis=-1)
    want = cvkern.gaussian(image, 2, channel_axis=-1)
    np.testing.assert_array_equal(np.array(target), want)
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), want)
    assert calls
    calls.clear()
    apply("gaussian", image, target[:, ::-1], tile=tile, sigma=2, channel_axis=-1)
    np.testing.assert_array_equal(np.array(target)[:, ::-1], want)
    assert not calls


def test_a_map_of_a_file_that_lost_its_name(tmp_path):
    """The name belongs to another file, which stays as it is."""
    want = cvkern.median(noise(), 2)
    target = np.lib.format.open_memmap(tmp_path / "out.npy", "w+", np.uint8, want.shape)
    (tmp_path / "out.npy").rename(tmp_path / "old.npy")
    np.save(tmp_path / "out.npy", np.zeros_like(want))
    apply("median", noise(), target, radius=2)
    np.testing.assert_array_equal(np.load(tmp_path / "old.npy"), want)
    assert not np.load(tmp_path / "out.npy").any()
    (tmp_path / "old.npy").unlink()
    target[:] = 0
    np.testing.assert_array_equal(np.array(apply("median", noise(), target, radius=2)), want)


def test_memory_of_a_private_map_is_kept(tmp_path):
    """Its pages are lost when they are let go of, because no file has them."""
    np.save(tmp_path / "in.npy", np.zeros((400, 97), np.uint8))
    source = np.load(tmp_path / "in.npy", mmap_mode="c")
    source[:] = np.tile(noise(), (7, 1))[:400]
    want = np.array(source)
    np.testing.assert_array_equal(apply("box", source, tile=100), cvkern.box(want))
    np.testing.assert_array_equal(np.array(source), want)


class Chunked(NamedTuple):
    """What an array in chunks tells of itself."""

    chunks: tuple[int, int]


def test_tiles_of_chunks_and_of_rows():
    def sides(shape, reach, *arrays, on_gpu=False):
        return grids.sides_of(shape, reach, arrays, (), on_gpu)

    plain = np.empty((1, 1), np.uint8)
    assert sides((30000, 30000), 8, plain) == (1024, 3750)
    assert sides((30000, 30000), 100, plain) == (1600, 2500)
    assert sides((100, 100, 3), 8, plain) == (1024, 100)
    assert sides((30000, 100000), 8, np.empty((1, 100000), np.float32)) == (167, 4000)
    assert sides((20000, 20000), 8, plain, on_gpu=True) == (1258, 20000)
    assert sides((7000, 60000), 100, plain, on_gpu=True) == (1600, 15728)
    big = np.empty((9000, 9000), np.uint8)
    assert sides(big.shape, 2, Chunked((1000, 700))) == (2000, 1400)
    assert sides(big.shape, 2, Chunked((3000, 300))) == (3000, 1800)
    assert sides(big.shape, 2, Chunked((100, 9000))) == (400, 9000)
    assert sides(big.shape, 2, memoryview(big)) == (2048, 2048)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    "head",
    [
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (1099511627776, 4), }",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (4611686018427387904, 4), }",
        b"{'descr': '|O', 'fortran_order': False, 'shape': (3,), }",
        b"{'descr': ''' ",
        None,
    ],
)
def test_arrays_of_damaged_files(tmp_path, head):
    """Neither a header's claim takes memory, nor does Python's tokenizer or pickle speak."""
    path = tmp_path / "a.npy"
    if head is None:
        np.savez(tmp_path / "a.npz", np.ones(3))
        path.write_bytes((tmp_path / "a.npz").read_bytes())
    else:
        head += b" " * (118 - len(head) - 1) + b"\n"
        path.write_bytes(b"\x93NUMPY\1\0" + len(head).to_bytes(2, "little") + head)
    with pytest.raises(ValueError, match="file must be an array of NumPy, got"):
        map_array(path, "file")


def test_metadata_of_zarr_that_is_damaged(tmp_path):
    zarr = pytest.importorskip("zarr")
    path = tmp_path / "a.zarr"
    zarr.open_array(str(path), mode="w", shape=(9, 9), chunks=(3, 3), dtype="u1")
    for file in (p for p in path.rglob("*") if p.is_file()):
        file.write_text("[]")
    with pytest.raises(ValueError, match="source must be an array of Zarr, got"):
        targets.zarr_array(path, "source", mode="r")
