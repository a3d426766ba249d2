"""Existing results are replaced only on request."""

import pytest

KEPT = b"made in an hour"
COMMANDS = {
    "edges": ["edges", "photo.png", "-o", "out.png", "--subpixel", "kept.csv",
              "--operator", "gaussian"],
    "lines": ["lines", "photo.png", "-o", "out.png", "--csv", "kept.csv"],
    "circles": ["circles", "photo.png", "-o", "out.png", "--radius", "9", "20",
                "--json", "kept.csv"],
    "find": ["find", "photo.png", "photo2.png", "-o", "out.png", "--csv", "kept.csv"],
    "match": ["match", "photo.png", "photo2.png", "-o", "out.png", "--csv", "kept.csv"],
    "nerf train": ["nerf", "train", "shapes", "-o", "kept.npz"],
    "nerf render": ["nerf", "render", "model.npz", "--orbit", "-o", "kept.gif"],
    "nerf export": ["nerf", "export", "model.npz", "-o", "kept.ply"],
    "nerf planes": ["nerf", "planes", "left.png", "right.png", "-o", "kept.html"],
}  # fmt: skip


@pytest.mark.parametrize("name", COMMANDS)
def test_results_are_not_replaced_unless_asked(command, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = COMMANDS[name]
    (kept,) = (tmp_path / word for word in words if word.startswith("kept"))
    kept.write_bytes(KEPT)
    code, _, said = command(*words)
    assert code == 2
    assert "must be a new file" in said
    # Nothing else is looked at before: that there is no photograph or model is said only then.
    also = ["--seconds", "-1"] if name == "nerf train" else []
    code, _, said = command(*words, "--overwrite", *also)
    assert code == 2
    assert "must be a new file" not in said
    assert kept.read_bytes() == KEPT
