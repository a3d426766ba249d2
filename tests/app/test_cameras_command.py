"""``cvkern cameras``, and ``cvkern nerf train`` of photographs without cameras."""

import json

import pytest

import cvkern
from cvkern.images import read_image, write_image
from cvkern.radiance import load_model
from tests.reconstruction import scenes

LENS = cvkern.Camera([[190.0, 0, 99.5], [0, 190, 74.5], [0, 0, 1]], shape=(150, 200))


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """Write three photographs of boards, one of something else, and a text."""
    folder = tmp_path_factory.mktemp("photographs")
    for n, image in enumerate(scenes.photographs(scenes.ring(3, spread=0.35), LENS)):
        write_image(folder / f"{n}.png", image)
    stranger = scenes.photographs(scenes.ring(1), LENS, seed=7)[0]
    write_image(folder / "stranger.png", stranger)
    (folder / "notes.txt").write_text("no photograph")
    return folder


def test_cameras(command, photographs, tmp_path):
    target = tmp_path / "out"
    code, out, _ = command("cameras", photographs, "-o", target, "--focal", "190")
    assert code == 0
    assert "3 of 4 photographs" in out
    assert "not placed: stranger.png" in out
    names = {"cameras.txt", "images.txt", "points3D.txt", "transforms.json", "points.ply"}
    assert {file.name for file in target.iterdir()} == {*names, "cameras.png"}
    found = cvkern.read_reconstruction(target)
    assert found.names == ("0.png", "1.png", "2.png")
    told = json.loads((target / "transforms.json").read_text())
    assert all((target / frame["file_path"]).is_file() for frame in told["frames"])
    assert read_image(target / "cameras.png").shape[2] == 3

    code, _, error = command("cameras", photographs, "-o", target)
    assert code == 2
    assert "output must have no results yet" in error
    code, *_ = command(
        "cameras", photographs, "-o", target, "--overwrite", "--binary", "--focal", 190
    )
    assert code == 0
    assert (target / "cameras.bin").exists()
    assert not (target / "cameras.txt").exists()


def test_resume(command, photographs, tmp_path, monkeypatch):
    from cvkern.reconstruction import _course

    target = tmp_path / "deep" / "out"
    options = "cameras", photographs, "-o", target, "--focal", "190", "--pairs", "sequence"

    def stop(*given):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(_course, "with_focals", stop)
        code, *_ = command(*options)
    assert code != 0
    assert [file.name for file in target.iterdir()] == ["journal"]
    code, _, error = command(*options)
    assert code == 2
    assert "--resume goes on with it" in error
    code, _, error = command(*options, "--resume", "--seed", "1")
    assert code == 2
    assert "journal must be of the same call" in error
    with monkeypatch.context() as patch:
        patch.delattr(_course, "match")
        code, out, _ = command(*options, "--resume", "--models", "largest")
    assert code == 0
    assert "3 of 4 photographs" in out
    assert not (target / "journal").exists()


def test_refusals(command, photographs, tmp_path):
    for arguments, text in (
        ((tmp_path / "no", "-o", tmp_path / "out"), "images must be a folder that exists"),
        ((tmp_path, "-o", tmp_path / "out"), "images must not be empty"),
        ((photographs, "-o", photographs), "output must not be the folder of photographs"),
        ((photographs, "-o", photographs / "0.png"), "output must be a folder"),
    ):
        code, _, error = command("cameras", *arguments)
        assert code == 2
        assert text in error
    assert not (tmp_path / "out").exists()
    write_image(tmp_path / "a.png", read_image(photographs / "0.png"))
    write_image(tmp_path / "b.png", read_image(photographs / "0.png"))
    for arguments in (
        ("cameras", tmp_path, "-o", tmp_path / "out"),
        ("nerf", "train", tmp_path, "-o", tmp_path / "m.npz", "--steps", "1"),
    ):
        code, _, error = command(*arguments)
        assert code == 2
        assert "photographs of one scene from several places" in error


def test_a_field_of_photographs(command, photographs, tmp_path):
    target = tmp_path / "model.npz"
    code, out, _ = command(
        "nerf", "train", photographs, "-o", target, "--steps", "2", "--test-every", "0"
    )
    assert code == 0
    assert "not placed: stranger.png" in out
    assert len(load_model(target).cameras) == 3
