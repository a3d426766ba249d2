"""The cases, by name; a family has the same file name here as in cvkern."""

from ..case import Case
from . import edges, filters

CASES: dict[str, Case] = {case.name: case for case in (*filters.CASES, *edges.CASES)}
