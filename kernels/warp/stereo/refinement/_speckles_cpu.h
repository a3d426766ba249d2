// Set a bit for each pixel of rows where a run begins, and for each that joins the one above.
void mark(int slab, int first, int last, wp::array_t<float> disparity, float difference,
          wp::array_t<wp::uint64> begins, wp::array_t<wp::uint64> joints) {
    enum { N = 64 };
    typedef float lanes __attribute__((vector_size(4 * N), aligned(4)));
    typedef bool flags __attribute__((ext_vector_type(N)));
    const int columns = disparity.shape[1], words = begins.shape[1];
    // The bits of up to N pixels that are near their neighbours.
    const auto near = [&](const float* a, const float* b, int number) {
        unsigned long long bits = 0;
        if (number < N) {
            for (int i = 0; i < number; ++i)
                bits |= (unsigned long long)(__builtin_fabsf(a[i] - b[i]) <= difference) << i;
            return bits;
        }
        const lanes apart = *(const lanes*)a - *(const lanes*)b;
        const flags found =
            __builtin_convertvector((apart < 0 ? -apart : apart) <= difference, flags);
        __builtin_memcpy(&bits, &found, sizeof bits);
        return bits;
    };
    for (int row = first; row < last; ++row) {
        const float* const line = disparity.data + (size_t)row * columns;
        unsigned long long before = 0;  // whether the last pixel is near the first one of the word
        for (int k = 0; k < words; ++k) {
            const int x = k * N, left = columns - x, number = left < N ? left : N;
            const unsigned long long inside = ~0ull >> (N - number);
            const unsigned long long alike = near(line + x + 1, line + x, left - 1);
            begins.data[(size_t)row * words + k] = ~(alike << 1 | before) & inside;
            before = alike >> (N - 1);
            if (row > 0)
                joints.data[(size_t)row * words + k] = near(line + x, line + x - columns, number);
        }
    }
}

// Keep the runs whose region, the root of their tree, has at least `min_size` pixels.
void keep(int slab, int first, int last, wp::array_t<float> disparity, int min_size,
          wp::array_t<wp::uint64> begins, wp::array_t<int> parents, wp::array_t<int> sizes,
          wp::array_t<float> kept) {
    const int columns = disparity.shape[1], words = begins.shape[1];
    const float none = __builtin_nanf("");
    for (int row = first; row < last; ++row) {
        const float* const from = disparity.data + (size_t)row * columns;
        float* const to = kept.data + (size_t)row * columns;
        bool large = false;
        for (int k = 0, x = 0; k < words; ++k) {
            const int end = 64 * k + 64 < columns ? 64 * k + 64 : columns;
            for (unsigned long long bits = begins.data[(size_t)row * words + k];;
                 bits &= bits - 1) {
                const int next = bits ? 64 * k + __builtin_ctzll(bits) : end;
#pragma clang loop vectorize(assume_safety)
                for (int i = x; i < next; ++i) to[i] = large ? from[i] : none;
                x = next;
                if (!bits) break;
                int label = row * columns + next;
                while (parents.data[label] != label) label = parents.data[label];
                large = sizes.data[label] >= min_size;
            }
        }
    }
}
