"""A run that was stopped, or killed, goes on where it was, and gives the same result."""

import subprocess
import sys

import numpy as np
import pytest

import cvkern
from cvkern.reconstruction import _course
from tests.reconstruction import scenes

LENS = cvkern.Camera([[190.0, 0, 99.5], [0, 190, 74.5], [0, 0, 1]], shape=(150, 200))


class Stopped(Exception):
    """What a test throws from within a run."""


@pytest.fixture(scope="module")
def images():
    return list(scenes.photographs(scenes.ring(4, spread=0.45), LENS))


@pytest.fixture(scope="module")
def whole(images):
    return cvkern.reconstruct(images)


def equal(one, other):
    for name in ("poses", "points", "colors", "tracks", "places", "errors"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(one.lenses[0].matrix, other.lenses[0].matrix)


def test_every_stage_is_done_once(images, whole, tmp_path, monkeypatch):
    journal = tmp_path / "journal"
    monkeypatch.setattr(_course, "SAVE_EVERY", 0.0)
    done = []
    for name in ("find_keypoints", "choose_pairs", "match", "with_focals"):
        call = getattr(_course, name)
        monkeypatch.setattr(
            _course,
            name,
            lambda *given, _name=name, _call=call: done.append(_name) or _call(*given),
        )

    def stopping(after):
        calls = []

        def say(*given):
            calls.append(given)
            if len(calls) == after:
                raise Stopped

        return say

    found, stops = None, 0
    while found is None:
        stops += 1
        try:
            found = cvkern.reconstruct(images, journal=journal, progress=stopping(2 * stops))
        except Stopped:
            assert (journal / "plan.json").is_file()
    assert stops > 5
    # Only the stage in which a run is stopped is done again.
    assert done == ["find_keypoints"] * 4 + ["choose_pairs", "match", "with_focals"]
    assert not journal.exists()
    equal(found, whole)


CHILD = """
import sys, time
import numpy as np
import cvkern

def say(done, total, text):
    if text == "Placing photographs" and done > 2:
        print("here", flush=True)
        time.sleep(600)

cvkern.reconstruct(list(np.load(sys.argv[1])), journal=sys.argv[2], progress=say)
"""


def test_a_killed_run_goes_on(images, whole, tmp_path, monkeypatch):
    journal = tmp_path / "journal"
    np.save(tmp_path / "images.npy", images)
    command = [sys.executable, "-c", CHILD, str(tmp_path / "images.npy"), str(journal)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "here\n"
        child.kill()
    assert (journal / "matches-0.npz").is_file()
    with pytest.raises(ValueError, match="journal must be of the same call"):
        cvkern.reconstruct(images, journal=journal, seed=1)
    # A file that was damaged since is no finished part.
    (journal / "keypoints-2.npz").write_bytes(b"half a file")
    monkeypatch.delattr(_course, "choose_pairs")
    equal(cvkern.reconstruct(images, journal=journal), whole)
    assert not journal.exists()
