"""The options of a product of samples and weights."""

import warp as wp

from cvkern.kernels.warp._structs import struct_of


@wp.struct
class Product:
    """A layer, forward or backward."""

    columns: int  # columns of the result
    column_in: int  # the first column that is read
    column_out: int  # the first column that is written
    relu: bool  # whether negative results become 0
    gated: bool  # whether the result is 0 where the gates are 0


def product_of(columns: int, column_in: int, column_out: int, relu: bool, gated: bool) -> Product:
    """Return a product with these options."""
    return struct_of(Product, (columns, column_in, column_out, relu, gated))
