// The number of bits in which two words differ.
struct Hamming {
    static int distance(unsigned long long a, unsigned long long b) { return __popcll(a ^ b); }
    static int distance(unsigned a, unsigned b) { return __popc(a ^ b); }
};
