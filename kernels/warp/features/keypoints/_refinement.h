#include "_paraboloid.h"

// needs MOVES
// Fit a paraboloid to extremum `n`, and move it to where that has its own.
void fit_one(int n, wp::array_t<wp::int64> octaves, float contrast, float edge, int margin,
             wp::array_t<float> offsets, wp::array_t<int> cells) {
    int* const cell = cells.data + 4 * (size_t)n;
    const wp::int64* const octave = octaves.data + 4 * (size_t)cell[0];
    Paraboloid found{(const float*)octave[0], (int)octave[1], (int)octave[2], (int)octave[3]};
    if (!found.fit(contrast, edge, margin, MOVES, cell[1], cell[2], cell[3])) cell[0] = -1;
    float* const offset = offsets.data + 4 * (size_t)n;
    offset[0] = (float)found.oy, offset[1] = (float)found.ox, offset[2] = (float)found.os;
    offset[3] = (float)wp::abs(found.top);
}

// Set the bit of the pixel at which the fit to extremum `n` ended, and count it in its row; one
// thread alone.
void keep_one(int n, wp::array_t<wp::int64> octaves, wp::array_t<int> cells, wp::array_t<int> words,
              wp::array_t<int> counts) {
    const int* const cell = cells.data + 4 * (size_t)n;
    if (cell[0] < 0) return;
    size_t word = 0, row = 0;
    const wp::int64* octave = octaves.data;
    for (int o = 0; o < cell[0]; ++o, octave += 4) {
        word += (size_t)(octave[1] * octave[2]) * ((octave[3] + 31) / 32);
        row += (size_t)(octave[1] * octave[2]);
    }
    const size_t line = (cell[1] - 1) * (size_t)octave[2] + cell[2];
    unsigned* const place =
        (unsigned*)words.data + word + line * ((octave[3] + 31) / 32) + cell[3] / 32;
    const unsigned bit = 1u << cell[3] % 32;
    if (*place & bit) return;
    *place |= bit;
    ++counts.data[row + line];
}
