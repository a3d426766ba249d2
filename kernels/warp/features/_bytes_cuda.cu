// Instructions of CUDA for matching, and the same in plain C++ where Warp compiles for the CPU.

int ones_of(wp::uint32 word) {
#if defined(__CUDA_ARCH__)
    return __popc(word);
#else
    return __builtin_popcount(word);
#endif
}

// Add the products of four pairs of bytes.
wp::uint32 dot4(wp::uint32 a, wp::uint32 b, wp::uint32 sum) {
#if defined(__CUDA_ARCH__)
    return __dp4a(a, b, sum);
#else
    for (int i = 0; i < 32; i += 8) sum += (a >> i & 255) * (b >> i & 255);
    return sum;
#endif
}
