// Four neighbouring pixels of both images: the census, shifted, and the grey value.
void pack(wp::array_t<wp::uint64> left_bits, wp::array_t<wp::uint64> right_bits,
          wp::array_t<wp::uint8> left, wp::array_t<wp::uint8> right,
          wp::array_t<wp::uint32> words) {
    const size_t plane = (size_t)words.shape[1] * words.shape[2];
    const size_t first = ((size_t)blockIdx.x * blockDim.x + threadIdx.x) * 4;
    if (first >= plane) return;
#pragma unroll
    for (int view = 0; view < 2; ++view) {
        const wp::uint64* bits = (view ? right_bits.data : left_bits.data) + first;
        const wp::uint8* gray = (view ? right.data : left.data) + first;
        unsigned* to = words.data + view * plane + first;
        if (plane % 4 == 0 && (size_t)bits % 16 == 0 && (size_t)gray % 4 == 0 &&
            (size_t)to % 16 == 0) {
            const uint4 one = ((const uint4*)bits)[0], two = ((const uint4*)bits)[1];
            const uchar4 shade = *(const uchar4*)gray;
            *(uint4*)to = make_uint4(one.x << 8 | shade.x, one.z << 8 | shade.y,
                                     two.x << 8 | shade.z, two.z << 8 | shade.w);
        } else {
            for (int i = 0; i < 4 && first + i < plane; ++i)
                to[i] = (unsigned)bits[i] << 8 | gray[i];
        }
    }
}

// needs BLOCK, SHIFT, WEIGHT, LIMIT, HALF, ALIGNED
// A word is a pixel: the census in the high bits, 8 bits of grey in the low bits. All pairs of 16
// pixels and 16 disparities need 31 adjacent words of the right image; their grey values are
// processed in fours.
void match_costs(wp::array_t<wp::uint32> words, int first, int depth,
                 wp::array_t<wp::uint8> costs) {
    const int height = costs.shape[0], width = costs.shape[1], padded = costs.shape[2];
    const int chunks = (padded + 15) / 16, groups = (width + 15) / 16;
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    const int k = i % chunks * 16, begin = i / chunks % groups * 16;
    const unsigned row = i / chunks / groups;
    if (row >= (unsigned)height) return;
    const unsigned* left = words.data + (size_t)row * width;
    const unsigned* right = left + (size_t)height * width;
    unsigned word[31], grey[28], none[4], here[16];
    // 16 bytes at once where they are aligned and within the row.
    const int from = begin - first - k - 16;
    const bool wide = from >= 0 && from + 32 <= width && begin + 16 <= width &&
                      ((size_t)(right + from) | (size_t)(left + begin)) % 16 == 0;
    if (wide) {
#pragma unroll
        for (int j = 0; j < 8; ++j) {
            const uint4 four = reinterpret_cast<const uint4*>(right + from)[j];
            if (j > 0) word[4 * j - 1] = four.x;
            word[4 * j] = four.y, word[4 * j + 1] = four.z, word[4 * j + 2] = four.w;
        }
#pragma unroll
        for (int j = 0; j < 4; ++j) {
            const uint4 four = reinterpret_cast<const uint4*>(left + begin)[j];
            here[4 * j] = four.x, here[4 * j + 1] = four.y;
            here[4 * j + 2] = four.z, here[4 * j + 3] = four.w;
        }
    } else {
#pragma unroll
        for (int j = 0; j < 31; ++j) word[j] = right[max(0, min(width - 1, from + 1 + j))];
#pragma unroll
        for (int j = 0; j < 16; ++j) here[j] = left[min(width - 1, begin + j)];
    }
    grey[0] = __byte_perm(__byte_perm(word[3], word[2], 0x0040),
                          __byte_perm(word[1], word[0], 0x0040), 0x5410);
#pragma unroll
    for (int j = 1; j < 28; ++j) grey[j] = __byte_perm(grey[j - 1], word[j + 3], 0x2104);
#pragma unroll
    for (int j = 0; j < 4; ++j) {
        // Places after the last disparity cost 255, more than every real cost.
        const int behind = k + 4 * j + 4 - depth;
        none[j] = behind <= 0 ? 0 : behind >= 4 ? ~0u : ~0u << 8 * (4 - behind);
    }
    unsigned char* to = costs.data + ((size_t)row * width + begin) * padded + k;
#pragma unroll
    for (int p = 0; p < 16; ++p) {
        if (begin + p >= width) break;
        const unsigned shade = (here[p] & 255) * 0x1010101u;
        unsigned packed[4];
#pragma unroll
        for (int j = 0; j < 4; ++j) {
            const unsigned difference = __vabsdiffu4(shade, grey[12 + p - 4 * j]);
            const unsigned even = __vminu2(difference >> SHIFT & HALF, LIMIT * 0x10001u);
            const unsigned odd = __vminu2(difference >> 8 + SHIFT & HALF, LIMIT * 0x10001u);
            packed[j] = even + odd * 256;
#pragma unroll
            for (int n = 0; n < 4; ++n) {
                const unsigned different = (here[p] ^ word[15 + p - 4 * j - n]) & 0xffffff00u;
                packed[j] += __popc(different) * (WEIGHT << 8 * n);
            }
            packed[j] |= none[j];
        }
        if (ALIGNED)
            *reinterpret_cast<uint4*>(to) = make_uint4(packed[0], packed[1], packed[2], packed[3]);
        else
            for (int j = 0; j < 16 && k + j < padded; ++j) to[j] = packed[j / 4] >> 8 * (j % 4);
        to += padded;
    }
}
// needs COST_TYPE, COST_BYTES, FAR, BLOCK
// One thread per chunk of 16 disparities copies rows of any length to rows of whole chunks.
void pad(wp::array_t<COST_TYPE> costs, wp::array_t<COST_TYPE> padded) {
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    const int depth = costs.shape[2], chunks = padded.shape[2] / 16, d = i % chunks * 16;
    const long long pixel = i / chunks;
    if (pixel >= (long long)padded.shape[0] * padded.shape[1]) return;
    const COST_TYPE* from = costs.data + pixel * depth;
    COST_TYPE value[16];
#pragma unroll
    for (int j = 0; j < 16; ++j) value[j] = d + j < depth ? from[d + j] : (COST_TYPE)FAR;
    uint4* to = reinterpret_cast<uint4*>(padded.data + pixel * padded.shape[2] + d);
#pragma unroll
    for (int j = 0; j < COST_BYTES; ++j) {
        unsigned word[4];
#pragma unroll
        for (int k = 0; k < 4; ++k)
            word[k] = COST_BYTES == 1
                          ? value[4 * k] | value[4 * k + 1] << 8 | value[4 * k + 2] << 16 |
                                (unsigned)value[4 * k + 3] << 24
                          : value[(8 * j + 2 * k) % 16] | (unsigned)value[(8 * j + 2 * k + 1) % 16]
                                                              << 16;
        to[j] = make_uint4(word[0], word[1], word[2], word[3]);
    }
}
