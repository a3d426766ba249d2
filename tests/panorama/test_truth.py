"""Real heaps with ground truth: which belong together, and a ring against Autostitch's cameras."""

import json

import numpy as np
import pytest

import cvkern
from cvkern.images import read_image
from cvkern.panorama.models import align
from cvkern.panorama.registration import link_images, make_small
from tests.panorama.scenes import angle_between
from tests.truth import truth


def test_groups():
    folder = truth("panorama")
    told = json.loads((folder / "groups.json").read_text())
    groups = [set(g) for g in told["groups"].values()] + [{d} for d in told["distractors"]]
    names = sorted(set().union(*groups))
    order = np.random.default_rng(0).permutation(len(names))
    names = [names[i] for i in order]
    found = cvkern.recognize_panoramas([read_image(folder / name) for name in names])
    assert {frozenset(names[i] for i in c) for c in found.components} == set(map(frozenset, groups))


@pytest.mark.parametrize("seed", [0])
def test_a_ring_of_autostitch(seed):
    folder = truth("panorama") / "ring_parrington"
    told = json.loads((folder / "ring.json").read_text())["files"]
    order = np.random.default_rng(seed).permutation(len(told))
    images = [read_image(folder / told[i]["file"]) for i in order]
    heap = make_small(images, None)
    links = link_images(heap, lambda *step: None)
    assert len(links) == len(told)
    sides = np.array([image.shape[1::-1] for image in images])
    found = align(links, sides, heap.factors, None)
    assert found.model == "rotation"
    theirs = np.median([file["autostitch_focal_px"] for file in told])
    assert abs(np.median(np.asarray(found.focals)) / theirs - 1) < 0.01
    assert found.residual < 0.35  # pixels; 0.93 without a lens
    rotations = np.asarray(found.rotations)[np.argsort(order)]
    wanted = np.array([file["autostitch_R"] for file in told])
    for i in range(len(told)):
        j = (i + 1) % len(told)
        got, want = angle_between(rotations[i], rotations[j]), angle_between(wanted[i], wanted[j])
        assert abs(got - want) < 0.3
