"""The stub of the kernels for type checkers: ``python -m tests.kernel_stub`` rewrites it."""

import pkgutil
from pathlib import Path

import cvkern.kernels.warp

STUB = Path(__file__).parents[1] / "cvkern" / "_kernels.pyi"
HEAD = "# Written by `python -m tests.kernel_stub`, from the folders of kernels/warp.\n"


def stub() -> str:
    """Return the tree of kernel modules as nested classes, whose attributes are the modules."""
    package = cvkern.kernels.warp
    lines = list(_folder(list(package.__path__), package.__name__, "    "))
    return f"{HEAD}class Folder:\n    def __init__(self, package: str) -> None: ...\n" + "".join(
        lines
    )


def _folder(paths: list[str], package: str, indent: str):
    public = [m for m in pkgutil.iter_modules(paths) if m.name[0] != "_"]
    modules = [m.name for m in public if not m.ispkg]
    for m in modules:
        yield f"{indent}from {package} import {m} as {m}\n"
    for m in public:
        if m.ispkg:
            yield f"{indent}class {m.name}:\n"
            inner = [f"{path}/{m.name}" for path in paths]
            yield from _folder(inner, f"{package}.{m.name}", indent + "    ")


if __name__ == "__main__":
    STUB.write_text(stub())
