// Count the set pixels of row y.
void count(int y, wp::array_t<wp::uint8> mask, wp::array_t<int> starts) {
    const int columns = mask.shape[1];
    const unsigned char* row = mask.data + (size_t)y * mask.strides[0];
    int number = 0;
    for (int x = 0; x < columns; ++x) number += row[x] != 0;
    starts.data[y + 1] = number;
}
