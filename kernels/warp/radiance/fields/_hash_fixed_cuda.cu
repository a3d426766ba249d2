#include "../_fixed_point.cu"

// needs UNIT, LIMIT
void add_two_fixed(wp::array_t<wp::int64> table, int low, int high, float x, float y, float z,
                   float w) {
    FixedPoint::add(table.data + 2 * (size_t)low, x);
    FixedPoint::add(table.data + 2 * (size_t)low + 1, y);
    FixedPoint::add(table.data + 2 * (size_t)high, z);
    FixedPoint::add(table.data + 2 * (size_t)high + 1, w);
}
