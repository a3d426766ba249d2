// Set the bit of an occupancy cell if a node is above `least`; a warp writes a word.
void mark_cell(int cell, wp::array_t<float> density, int cells, int size, float least,
               wp::array_t<unsigned> bits) {
    const int i = cell % cells * size, j = cell / cells % cells * size;
    const int k = cell / (cells * cells) * size, side = density.shape[0];
    bool found = false;
    for (int z = k; z <= k + size; ++z)
        for (int y = j; y <= j + size; ++y) {
            const float* row = density.data + ((size_t)z * side + y) * side + i;
            for (int x = 0; x <= size; ++x) found |= row[x] > least;
        }
    const unsigned word = __ballot_sync(0xffffffffu, found);
    if (threadIdx.x % 32 == 0) bits.data[cell / 32] = word;
}
