"""The cases, by name; a family has the same file name here as in cvkern."""

from ..case import Case
from . import depth, edges, filters, gradients, rank

FAMILIES = (filters, gradients, rank, edges, depth)
CASES: dict[str, Case] = {case.name: case for family in FAMILIES for case in family.CASES}
