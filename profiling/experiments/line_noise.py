"""Peaks of lines against noise and bin size, of plain, smoothed and directed votes.

python -m profiling.experiments.line_noise profiling/results/experiments/line_noise.json
"""

import json
import sys
from pathlib import Path

from cvkern._files import replacing, write_text
from cvkern.app.tour import line_noise

TRIALS = 100


def main(file: Path) -> None:
    """Write the means over the trials to `file`; the tour has them as plots."""
    result = {
        "trials": TRIALS,
        "points of the line": line_noise.POINTS,
        "other points": line_noise.CLUTTER,
        "noise [pixels]": line_noise.NOISE,
        "by noise": line_noise.by_noise(TRIALS),
        "bins [pixels]": line_noise.BINS,
        "noise by bins [pixels]": line_noise.BIN_NOISE,
        "false peaks by bins": line_noise.by_bins(TRIALS),
    }
    with replacing(file) as beside:
        write_text(beside, json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
