"""Parts shared by tests of trained fields: small fields, equal models, interrupts."""

import os
import signal

import numpy as np
import pytest

from cvkern.radiance import HashField, VoxelField
from cvkern.radiance.trainer import Trainer

TINY = HashField(
    levels=8, table_bits=12, coarsest=8, finest=64, samples=2**12, rays=2**9, cells=32
)  # fmt: skip
GRID = VoxelField(resolutions=(16, 32), shares=(0.3,), rays=2**9)
FIELDS = pytest.mark.parametrize("field", [TINY, GRID], ids=["hash", "voxel"])


def same(a, b):
    """Whether two models have the same parameters, bit for bit."""
    a, b = a.field.state(), b.field.state()
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)


def interrupt(monkeypatch, step, how):
    """Call `how` after so many steps."""
    repeat = Trainer.repeat

    def interrupted(self):
        repeat(self)
        if self.model.training.step + 1 == step:
            how()

    monkeypatch.setattr(Trainer, "repeat", interrupted)


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)
