#pragma once

// The cell of a sample in a level of a hash encoding, and the corners of that cell. The bits of a
// corner's number tell on which sides of the cell it is.
struct HashCell {
    int i, j, k;
    float fi, fj, fk;  // offsets from the lower corner, in cells

    // Find the cell of a position from 0 to 1; a position at 1 is in the last cell.
    // Truncation rounds down.
    HashCell(const float* at, int cells) {
#pragma clang fp contract(fast)
        const float n = (float)cells;
        const float x = at[0] * n, y = at[1] * n, z = at[2] * n;
        const int last = cells - 1;
        i = (int)x, j = (int)y, k = (int)z;
        i = i < 0 ? 0 : i > last ? last : i;
        j = j < 0 ? 0 : j > last ? last : j;
        k = k < 0 ? 0 : k > last ? last : k;
        fi = x - (float)i, fj = y - (float)j, fk = z - (float)k;
    }

    // Return the weight of a corner.
    float share(int corner) const {
        return ((corner & 1) ? fi : 1.0f - fi) * ((corner & 2) ? fj : 1.0f - fj) *
               ((corner & 4) ? fk : 1.0f - fk);
    }

    // Return the entry of a corner in a table with one entry per corner.
    int flat(int corner, int cells) const {
        const int x = i + (corner & 1), y = j + (corner >> 1 & 1), z = k + (corner >> 2);
        return (z * (cells + 1) + y) * (cells + 1) + x;
    }

    // Return the entry of a corner by its hash.
    int mixed(int corner, unsigned mask) const {
        const int x = i + (corner & 1), y = j + (corner >> 1 & 1), z = k + (corner >> 2);
        return (int)(((unsigned)x ^ (unsigned)y * PRIME_Y ^ (unsigned)z * PRIME_Z) & mask);
    }
};
