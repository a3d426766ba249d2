"""Every case runs; a wrong answer stops it; the report shows the result."""

import dataclasses
import json

import numpy as np
import pytest

import cvkern
from profiling import __main__ as program
from profiling import arrays, record, report
from profiling.case import TOY, Case, CheckFailedError, Peer, Work, relative
from profiling.cases import CASES
from profiling.clock import HostClock, copy_bandwidth
from profiling.runner import Bench

pytest.importorskip("cv2")
pytest.importorskip("skimage")


def bench(backend="warp", seed=0):
    return Bench("cpu", backend, HostClock(), np.random.default_rng(seed), 1e10, toy=True)


# Some with Taichi as well, whose answers the tests of the families compare.
RUNS = [(name, "warp") for name in CASES] + [(name, "taichi") for name in list(CASES)[::6]]


@pytest.mark.parametrize(("name", "set_name"), RUNS)
def test_every_case_runs_and_is_right(name, set_name):
    pytest.importorskip(set_name)
    with cvkern.use(backend=set_name, device="cpu"):
        result = bench(set_name).run(CASES[name], TOY)
    ours, *peers = result["contenders"]
    assert ours["name"] == "cvkern"
    assert ours["difference"] <= CASES[name].tolerance
    assert ours["median_s"] > 0
    assert [peer["name"] for peer in peers if peer["status"] == "failed"] == []
    json.dumps(result, allow_nan=False)


def _one_pixel(mask):
    mask[40, 50] = ~mask[40, 50]
    return mask


WRONG = {
    "another sigma": ("gaussian", lambda x: cvkern.gaussian(x, 2.01)),
    "another border": ("gaussian", lambda x: cvkern.gaussian(x, 2.0, mode="nearest")),
    "NaN": ("gaussian", lambda x: np.full_like(x, np.nan)),
    "another shape": ("gaussian", lambda x: cvkern.gaussian(x, 2.0)[1:]),
    "a field missing": ("gradient_sobel", lambda x: tuple(np.gradient(x))),
    "one pixel": ("canny_l1_noise", lambda x: _one_pixel(CASES["canny_l1_noise"].call(x))),
    "one value": ("median", lambda x: cvkern.median(x, 2, mode="mirror")),
    "half the disparities": (
        "stereo_8_paths",
        lambda x, y: cvkern.stereo_match(x, y, (0, 8)).disparity,
    ),
    "other thresholds": (
        "canny_gaussian_noise",
        lambda x: cvkern.canny(x, 2.0, 0.15, 0.32, operator="gaussian", mode="reflect"),
    ),
    "whole pixels": ("subpixel_edges", lambda x: (np.argwhere(cvkern.canny(x, 2.0, 0.16, 0.32)),)),
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_wrong_answer_is_not_timed(fault):
    name, call = WRONG[fault]
    case = dataclasses.replace(CASES[name], call=call)
    with cvkern.use(backend="warp", device="cpu"), pytest.raises(CheckFailedError, match=name):
        bench().run(case, TOY)


def test_a_peer_that_is_absent_or_fails_is_recorded():
    case = dataclasses.replace(
        CASES["box"],
        peers=(
            Peer("absent", "no_such_library", lambda m, x: x),
            Peer("broken", "numpy", lambda m, x: m.no_such_function(x)),
            Peer("wrong shape", "numpy", lambda m, x: x[1:]),
            Peer("other", "numpy", lambda m, x: x, note="does nothing"),
            Peer("elsewhere", "numpy", lambda m, x: x, "cuda"),
        ),
    )
    with cvkern.use(backend="warp", device="cpu"):
        _, *peers = bench().run(case, TOY)["contenders"]
    said = {peer["name"]: (peer["status"], peer.get("reason", "")) for peer in peers}
    assert said["absent"][0] == "absent"
    assert "no_such_library" in said["absent"][1]
    assert said["broken"][0] == "failed"
    assert said["wrong shape"][0] == "failed"
    assert said["other"][0] == "timed"
    assert "elsewhere" not in said
    assert not next(peer for peer in peers if peer["name"] == "other")["same"]


def _difference(a, b):
    return b.astype(np.float32) - a


PAIR = Case(
    name="pair",
    title="One image less another",
    image=lambda shape, rng: (arrays.noise_uint8(shape, rng), arrays.noise_uint8(shape, rng)),
    call=lambda a, b: cvkern.gaussian(_difference(a, b), 0),
    oracle=lambda a, b: b - a.astype(np.float64),
    oracle_name="NumPy in float64",
    difference=relative,
    tolerance=0.0,
    bytes_per_pixel=6,
    operations_per_pixel=1,
    peers=(
        Peer("NumPy", "numpy", lambda m, a, b: m.subtract(b, a, dtype=np.int16)),
        Peer("the other way", "numpy", lambda m, a, b: m.subtract(a, b, dtype=np.int16)),
    ),
    work=Work("subtractions", lambda a, b: min(a.size, b.size)),
)


def test_a_case_of_two_images_and_its_rate():
    with cvkern.use(backend="warp", device="cpu"):
        result = bench().run(PAIR, TOY)
    ours, numpy, other = result["contenders"]
    assert result["dtype"] == "uint8"
    assert result["work"] == {"unit": "subtractions", "count": 96 * 128}
    for one in (ours, numpy, other):
        np.testing.assert_allclose(one["work_per_s"] * one["median_s"], 96 * 128)
    assert numpy["same"]
    assert not other["same"]
    json.dumps(result, allow_nan=False)
    swapped = dataclasses.replace(PAIR, call=lambda a, b: PAIR.call(b, a))
    with cvkern.use(backend="warp", device="cpu"), pytest.raises(CheckFailedError, match="pair"):
        bench().run(swapped, TOY)


def test_answers_that_are_no_images_are_compared_whole():
    right = (np.arange(6.0).reshape(2, 3),)
    assert dataclasses.replace(PAIR, margin=0).compare(right[0] + 1, right) == 0.2


def test_there_are_no_more_inputs_than_a_case_allows(monkeypatch):
    made = []
    case = dataclasses.replace(
        PAIR, image=lambda *a: made.append(a) or PAIR.image(*a), most_inputs=3, peers=()
    )
    with cvkern.use(backend="warp", device="cpu"):
        monkeypatch.setattr("profiling.runner.ROUNDS", 1)
        dataclasses.replace(bench(), toy=False).run(case, TOY)
    assert len(made) == 3


def test_photograph_is_mirrored_to_any_size():
    photo = arrays.photograph_uint8((700, 1300), np.random.default_rng(3))
    assert photo.shape == (700, 1300)
    np.testing.assert_array_equal(photo[:, :276], photo[:, 1024:])  # there and back: 2 x 512
    seams = [i for i in range(1299) if np.array_equal(photo[:, i], photo[:, i + 1])]
    assert len(seams) >= 2
    assert arrays.photograph((20, 30), np.random.default_rng(3)).max() <= 1


def test_relative_difference_does_not_hide_nan_or_shape():
    right = (np.ones((2, 2)), np.ones((2, 2)))
    assert np.isnan(relative((np.array([[1.0, np.nan], [1.0, 1.0]]), right[1]), right))
    assert relative((np.ones((2, 3)), right[1]), right) == np.inf
    assert relative((right[0], right[1] * 1.5), right) == 0.5
    assert relative(right, right) == 0


def test_copy_bandwidth_is_measured():
    assert copy_bandwidth(HostClock(), 1 << 20) > 0


def test_program_writes_a_whole_result(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("CVKERN_COMMIT", "abc")
    path = tmp_path / "result.json"
    command = ["--toy", "--case", "box", "median", "--seed", "1", "--json", str(path)]
    assert program.main(command) == 0
    result = json.loads(path.read_text())
    assert [r["case"] for r in result["results"]] == ["box", "median"]
    assert result["command"] == "python -m profiling --toy --case box median --seed 1"
    assert {"date", "versions", "device", "host", "backend", "seed"} <= set(result)
    assert result["commit"] == "abc as told"
    assert str(tmp_path) not in path.read_text()
    assert "OpenCV" in capsys.readouterr().out


def test_program_runs_the_sizes_of_each_case(monkeypatch, capsys):
    ran = []
    monkeypatch.setattr(Bench, "run", lambda bench, case, shape: ran.append(shape) or 1 / 0)
    monkeypatch.setattr(program.clock, "copy_bandwidth", lambda *a: 1e9)
    case = dataclasses.replace(CASES["box"], sizes=("1024x440",))
    monkeypatch.setitem(program.CASES, "box", case)
    program.main(["--case", "box", "median"])
    assert ran == [(440, 1024), (1080, 1920), (2160, 3840)]
    program.main(["--case", "box", "--size", "8192"])
    assert ran[3:] == [(8192, 8192)]


def test_program_says_what_failed(tmp_path, monkeypatch, capsys):
    wrong = dataclasses.replace(CASES["box"], call=lambda x: x)
    monkeypatch.setitem(program.CASES, "box", wrong)
    path = tmp_path / "result.json"
    assert program.main(["--toy", "--case", "box", "--json", str(path)]) == 1
    result = json.loads(path.read_text())
    assert result["results"] == []
    assert "uniform_filter" in result["failures"][0]["reason"]
    assert "not timed" in capsys.readouterr().out


def test_only_what_a_commit_holds_is_recorded(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(record, "_commit", lambda: "abcdef123456-dirty")
    monkeypatch.setattr(program.clock, "copy_bandwidth", lambda *a: 1e9)
    path = tmp_path / "result.json"
    assert program.main(["--case", "box", "--json", str(path)]) == 2
    assert "abcdef123456-dirty" in " ".join(capsys.readouterr().err.split())
    with pytest.raises(ValueError, match="abcdef123456-dirty"):
        record.write_json(path, {"commit": "abcdef123456-dirty", "command": "python -m profiling"})
    assert not path.exists()


def test_a_result_that_cannot_be_written_leaves_the_old_one(tmp_path):
    path = tmp_path / "result.json"
    path.write_text("old")
    with pytest.raises(ValueError, match="JSON"):
        record.write_json(path, {"value": float("nan")})
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def _contender(name, ms, ratio, **more):
    return {"name": name, "status": "timed", "median_s": ms / 1e3, "ratio": ratio} | more


def _run(date="2026-01-02T00:00:00+00:00", ms=2.0, **more):
    row = {"case": "box", "title": "Mean of 9 x 9", "size": "1080p"}
    contenders = [
        _contender("cvkern", ms, 1.0),
        _contender("SciPy", 8.0, 8.0 / ms),
        _contender("OpenCV", 1.0, 1.0 / ms, note="in float64"),
        {"name": "kornia-rs", "status": "absent", "reason": "ModuleNotFoundError"},
    ]
    return {
        "date": date,
        "commit": "abc",
        "toy": False,
        "backend": "warp",
        "device": {"kind": "cpu", "name": "A CPU"},
        "host": {"cores": 2},
        "results": [row | {"contenders": contenders}],
        "failures": [],
    } | more


@pytest.fixture
def project(tmp_path):
    """A page with markers, and one result."""
    results = tmp_path / "profiling" / "results"
    results.mkdir(parents=True)
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "measured.md").write_text(f"# head\n{report.BEGIN}\n{report.END}\ntail\n")
    (results / "cpu.json").write_text(json.dumps(_run()))
    return tmp_path


def _report(project, *more):
    places = [
        "--page",
        project / "docs" / "measured.md",
        "--results",
        project / "profiling" / "results",
    ]
    return report.main([*map(str, places), *more])


def test_report_writes_table_and_plot(project):
    pytest.importorskip("matplotlib")
    assert _report(project, "--check") == 1
    assert _report(project) == 0
    assert _report(project, "--check") == 0
    text = (project / "docs" / "measured.md").read_text()
    assert text.startswith("# head\n")
    assert text.endswith("\ntail\n")
    assert "A CPU, 2 cores, Warp kernels" in text
    assert "| Mean of 9 x 9 | 1080p | 2 | 1 (OpenCV) | 2.00 x slower |" in text
    assert "OpenCV in box (in float64)" in text
    assert "kornia-rs (absent)" in text
    assert f"]({report.PLOT})" in text
    plot = (project / "docs" / report.PLOT).read_text()
    assert report.SLOWER in plot
    assert report.FASTER not in plot
    _report(project)
    assert (project / "docs" / report.PLOT).read_text() == plot


def test_report_tells_rates(project):
    results = project / "profiling" / "results"
    run = _run()
    run["results"].append({"case": "votes", "title": "Votes", "size": "4K"} | {
        "work": {"unit": "votes", "count": 1e9},
        "contenders": [
            _contender("cvkern", 8.0, 1.0, work_per_s=1.25e11),
            _contender("cvkern, graph", 4.0, 0.5, work_per_s=2.5e11),
            _contender("OpenCV", 1e4, 1250.0, work_per_s=1e7),
        ],
    })  # fmt: skip
    (results / "cpu.json").write_text(json.dumps(run))
    text = report.section(report.read_results(results), "ratios.svg")
    assert "| as a graph | rate, of the faster | fastest peer |" in text
    assert "| Votes | 4K | 8 | 4 | 250 Gvotes/s | 1e+04 (OpenCV) | 1250.00 x faster |" in text
    assert "| Mean of 9 x 9 | 1080p | 2 |  |  | 1 (OpenCV) | 2.00 x slower |" in text
    votes = run["results"][1]
    assert report.rate(votes, votes["contenders"][2]) == "10 Mvotes/s"


def test_report_shows_the_latest_run_and_no_toy(project):
    results = project / "profiling" / "results"
    (results / "a.json").write_text(json.dumps(_run("2026-03-04T00:00:00+00:00", ms=0.5)))
    (results / "b.json").write_text(json.dumps(_run("2026-05-06T00:00:00+00:00", toy=True)))
    text = report.section(report.read_results(results), "ratios.svg")
    assert "2.00 x faster" in text
    assert "slower" not in text


def test_report_leaves_experiments_alone(project):
    results = project / "profiling" / "results"
    before = report.read_results(results)
    (results / "window_size.json").write_text(json.dumps({"windows": [3, 5], "results": {}}))
    assert report.read_results(results) == before


def test_report_drops_what_a_later_check_found_wrong(project):
    results = project / "profiling" / "results"
    failure = {"case": "box", "size": "1080p", "reason": "wrong"}
    later = _run("2026-03-04T00:00:00+00:00", results=[], failures=[failure])
    (results / "later.json").write_text(json.dumps(later))
    assert report.read_results(results) == {}


def test_report_needs_its_markers(project, capsys):
    (project / "docs" / "measured.md").write_text("no markers")
    assert _report(project) == 2
    assert report.BEGIN in capsys.readouterr().err
    assert (project / "docs" / "measured.md").read_text() == "no markers"
