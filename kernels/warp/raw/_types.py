"""Constants of native code that depend on the type of the values of an image."""

from typing import Any

import warp as wp

_HIGHEST = {wp.uint8: 255, wp.uint16: 65535, wp.float32: 0}


def constants(scalar: Any) -> dict[str, Any]:
    """Return the name of a type in C, whether it is integral, and its highest value."""
    highest = _HIGHEST[scalar]
    return {"TYPE": scalar, "INTEGRAL": int(highest > 0), "HIGHEST": highest}
