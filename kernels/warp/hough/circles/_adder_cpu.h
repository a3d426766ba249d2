// Sums of 512 pixels at once, a bit each: a full adder reduces three bits to two.
struct Adder {
    typedef unsigned long long Bits __attribute__((vector_size(64)));

    // Add two bits to a sum of one; return the carry.
    static Bits add(Bits& sum, Bits a, Bits b) {
        const Bits half = sum ^ a, carry = (sum & a) | (half & b);
        sum = half ^ b;
        return carry;
    }
};
