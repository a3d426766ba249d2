"""The cases, by name; a family has the same file name here as in cvkern."""

from ..case import Case
from . import (
    circles,
    depth,
    edges,
    filters,
    gradients,
    lines,
    rank,
    semi_global,
    shapes,
    stereo,
    stereo_cost,
)

FAMILIES = (
    filters, gradients, rank, edges, lines, circles, shapes,
    stereo_cost, semi_global, stereo, depth,
)  # fmt: skip
CASES: dict[str, Case] = {case.name: case for family in FAMILIES for case in family.CASES}
