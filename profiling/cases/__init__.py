"""The cases, by name; a family has the same file name here as in cvkern."""

from ..case import Case
from . import depth, edges, filters, gradients, rank, semi_global, stereo, stereo_cost

FAMILIES = (filters, gradients, rank, edges, depth, semi_global, stereo, stereo_cost)
CASES: dict[str, Case] = {case.name: case for family in FAMILIES for case in family.CASES}
