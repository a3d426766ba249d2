// needs TYPE, INDICES
void left_right(int slab, int begin, int end, wp::array_t<float> disparity, wp::array_t<TYPE> right,
                int first, float tolerance, wp::array_t<float> checked) {
    const int columns = disparity.shape[1];
    const float none = __builtin_nanf("");
    for (int row = begin; row < end; ++row) {
        const float* from = disparity.data + (size_t)row * columns;
        const TYPE* other = right.data + (size_t)row * columns;
        float* to = checked.data + (size_t)row * columns;
        for (int x = 0; x < columns; ++x) {
            const float d = from[x], at = x - __builtin_floorf(d + 0.5f);
            const bool inside = at >= 0.0f && at < columns;
            const TYPE match = other[inside ? (int)at : 0];
            const bool exists = INDICES ? match >= 0 : true;
            const float there = INDICES ? (float)(first + (int)match) : (float)match;
            const bool kept = inside && exists && __builtin_fabsf(d - there) <= tolerance;
            to[x] = kept ? d : none;
        }
    }
}

void fill(int slab, int first, int last, wp::array_t<float> disparity, wp::array_t<float> filled,
          wp::array_t<wp::uint8> valid, wp::array_t<int> found) {
    const int columns = disparity.shape[1];
    const float infinite = __builtin_inff();
    for (int row = first; row < last; ++row) {
        const float* from = disparity.data + (size_t)row * columns;
        float* to = filled.data + (size_t)row * columns;
        unsigned char* is = valid.data + (size_t)row * columns;
        float nearest = infinite;
        for (int x = 0; x < columns; ++x) {
            is[x] = __builtin_fabsf(from[x]) < infinite;
            nearest = is[x] ? from[x] : nearest;
            to[x] = nearest;
        }
        found.data[row] = nearest < infinite;
        nearest = infinite;
        for (int x = columns - 1; x >= 0; --x) {
            nearest = is[x] ? to[x] : nearest;
            to[x] = nearest < to[x] ? nearest : to[x];
        }
    }
}
