"""The cases, by name; a family has the same file name here as in cvkern."""

from ..case import Case
from . import circles, edges, filters, gradients, lines, rank, shapes

FAMILIES = (filters, gradients, rank, edges, lines, shapes, circles)
CASES: dict[str, Case] = {case.name: case for family in FAMILIES for case in family.CASES}
