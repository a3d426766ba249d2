"""Tables of octaves, which are kept on their device for later calls."""

import warp as wp

from cvkern.kernels.warp.features import _levels


def test_kernels_end_before_the_tables_that_they_read(monkeypatch):
    kept = _levels._thread.kept
    monkeypatch.setattr(_levels._thread, "kept", {})
    there = []  # how many tables there were when the device was waited for, but after each copy
    monkeypatch.setattr(
        wp, "synchronize_device", lambda device: there.append(len(_levels._thread.kept))
    )
    for n in range(_levels._MOST_TABLES + 1):
        table = _levels.kept_table([[n, 1]], wp.get_device("cpu"))
        assert table.numpy().tolist() == [[n, 1]]
        assert _levels.kept_table([[n, 1]], wp.get_device("cpu")) is table
    most = _levels._MOST_TABLES
    assert there == [*range(1, most + 1), most, 1]
    assert kept is not _levels._thread.kept
